//! Live environments: a WebSocket each, and a thread that steps a `World` of one environment.
//!
//! Messages to the server are [`message::Command`]s in JSON. Messages to the page are JSON in text, and frames: binary, the
//! length of a JSON head (u32, little-endian), the head, and the image `[H, W, 3]` u8 RGB; or a head with `video` and a file.

pub(crate) mod catalog;
mod history;
mod inbox;
mod message;
mod observed_policy;
mod planner;
mod recording;
mod session;
mod stage;
mod steer;
mod take;
mod task;

use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use tokio::sync::mpsc;

use crate::error::Refusal;
use crate::server::{App, MAX_MESSAGE_BYTES, Seat};
use inbox::Inbox;

/// Messages that may wait for the socket.
const MESSAGES_WAITING: usize = 2;

/// Opens a live environment, if there is room for one more.
pub(crate) async fn connect(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    let Some(seat) = app.seat() else {
        let reason = "as many environments are open as `max_sessions` of `swm ui` allows; close another page";
        return Refusal::new(StatusCode::SERVICE_UNAVAILABLE, reason).into_response();
    };
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    upgrade.on_upgrade(move |socket| serve(app, seat, socket))
}

/// Carries messages between the socket and the session until either ends.
async fn serve(app: Arc<App>, seat: Seat, mut socket: WebSocket) {
    let inbox = Arc::new(Inbox::default());
    let (outbox, mut frames) = mpsc::channel(MESSAGES_WAITING);
    let _closed = CloseOnDrop(Arc::clone(&inbox));
    let (its_app, its_inbox) = (Arc::clone(&app), Arc::clone(&inbox));
    let work = move || {
        // The place is free when the environment is gone, not when its page is.
        let _seat = seat;
        session::run(&its_app, &its_inbox, outbox);
    };
    match std::thread::Builder::new().name("swm-ui-play".to_owned()).spawn(work) {
        Ok(thread) => app.keep(thread),
        Err(_) => return,
    }
    loop {
        tokio::select! {
            frame = frames.recv() => {
                let Some(frame) = frame else { break };
                if socket.send(frame).await.is_err() {
                    break;
                }
            }
            received = socket.recv() => match received {
                Some(Ok(Message::Text(text))) => {
                    app.touch();
                    if !inbox.push(text.as_str()) {
                        let frame = CloseFrame { code: close_code::POLICY, reason: "too many messages at once".into() };
                        let _ = socket.send(Message::Close(Some(frame))).await;
                        break;
                    }
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => break,
            },
        }
    }
}

/// Tells the session that its page is gone, also where the server ends amid a message.
struct CloseOnDrop(Arc<Inbox>);

impl Drop for CloseOnDrop {
    fn drop(&mut self) {
        self.0.close();
    }
}
