//! The thread of a live environment: obeys the page, steps at the chosen rate, and sends frames.

use std::io::Write as _;
use std::time::{Duration, Instant};

use axum::extract::ws::Message;
use serde::Serialize;
use serde_json::{Value as Json, json};
use swm_core::settings::describe;
use swm_core::{ImageSize, PolicyArgs};
use swm_solvers::registered_model;
use tokio::sync::mpsc::Sender;

use super::inbox::Inbox;
use super::message::{Command, Open};
use super::recording::Recording;
use super::stage::{Point, Stage};
use super::task::Task;
use crate::error::Refusal;
use crate::server::App;

/// The side of the largest image that is shown live.
const MAX_IMAGE: usize = 512;
const MAX_HZ: f64 = 60.0;
/// After an episode its last image stays so long before the next one begins.
const PAUSE_AFTER_EPISODE: Duration = Duration::from_millis(700);
/// Frames that the page has not shown yet. While the environment plays, one more would only be older when it is seen, and sockets
/// hold many: the next one leaves when the last one is shown.
const MAX_UNSEEN: u64 = 1;

struct Session<'a> {
    app: &'a App,
    inbox: &'a Inbox,
    out: Sender<Message>,
    /// Frames that were sent.
    sent: u64,
    /// There is a later image than the one that was sent last.
    is_behind: bool,
    stage: Option<Stage>,
    recording: Option<Recording>,
    is_playing: bool,
    period: Duration,
    /// When the next step is due.
    next: Instant,
    /// Steps that the page has not got yet.
    points: Vec<Point>,
}

/// Serves a page until it is gone.
pub(super) fn run(app: &App, inbox: &Inbox, out: Sender<Message>) {
    let mut session = Session {
        app,
        inbox,
        out,
        sent: 0,
        is_behind: false,
        stage: None,
        recording: None,
        is_playing: false,
        period: Duration::from_millis(100),
        next: Instant::now(),
        points: Vec::new(),
    };
    while let Ok(command) = inbox.next(session.is_playing.then_some(session.next)) {
        let done = match command {
            Some(Ok(command)) => session.obey(command),
            Some(Err(reason)) => Err(Refusal::bad(reason)),
            None => session.tick(),
        };
        if let Err(refusal) = done {
            session.is_playing = false;
            session.tell(&json!({ "kind": "error", "text": refusal.reason }));
            session.frame();
        }
        if session.out.is_closed() {
            break;
        }
    }
    if let Some(recording) = &mut session.recording
        && let Err(error) = recording.commit()
    {
        // Where nobody reads stderr, the page goes on.
        let _ = writeln!(std::io::stderr(), "the last episode of {} is lost: {error}", recording.name);
    }
}

impl Session<'_> {
    fn obey(&mut self, command: Command) -> Result<(), Refusal> {
        let registry = &self.app.registry;
        match command {
            Command::Open(open) => return self.open(&open),
            Command::Play { on } => {
                (self.is_playing, self.next) = (on, Instant::now());
                self.frame();
            }
            Command::Rate { hz } => {
                if !(hz > 0.0 && hz <= MAX_HZ) {
                    return Err(Refusal::bad(format!("{hz} steps a second; use up to {MAX_HZ}")));
                }
                self.period = Duration::from_secs_f64(1.0 / hz);
                self.next = Instant::now();
            }
            Command::Reset(reset) => {
                self.points.clear();
                let done = self.stage()?.reset(registry, &reset);
                self.begun();
                done?;
            }
            Command::Step => self.step()?,
            Command::Action { values } => {
                let stage = self.stage()?;
                stage.set_pointer(None);
                stage.set_hand(values)?;
            }
            Command::Pointer { at } => self.stage()?.set_pointer(at),
            Command::Policy { text } => {
                let parse = |text: String| PolicyArgs::parse(&registered_model(registry, &text)?);
                let args = text.map(parse).transpose()?;
                args.iter().try_for_each(|args| self.app.roots.check_policy(args))?;
                self.stage()?.choose_policy(registry, args)?;
                self.frame();
            }
            Command::Rewind { step } => {
                self.is_playing = false;
                self.points.clear();
                self.stage()?.rewind(registry, step)?;
                self.frame();
            }
            Command::Watch { columns } => {
                let stage = self.stage()?;
                stage.watch(&columns);
                let plotted = stage.plotted();
                self.points.clear();
                self.tell(&json!({ "kind": "plotted", "names": plotted }));
            }
            Command::Record { file, format, image } => self.record(file, format, image)?,
            Command::Keep => {
                self.keep()?;
                self.next_episode()?;
            }
            Command::Undo => {
                self.recording()?.undo()?;
                self.frame();
            }
            Command::StopRecording => {
                self.recording()?.commit()?;
                let file = self.recording.take().map(|recording| self.app.roots.saved_id(&recording.name));
                self.tell(&json!({ "kind": "recorded", "id": file }));
                self.frame();
            }
            Command::Video => self.video()?,
            Command::Shown => {
                if self.is_behind {
                    self.frame();
                }
            }
        }
        Ok(())
    }

    fn stage(&mut self) -> Result<&mut Stage, Refusal> {
        self.stage.as_mut().ok_or_else(|| Refusal::bad("no environment is open"))
    }

    fn recording(&mut self) -> Result<&mut Recording, Refusal> {
        self.recording.as_mut().ok_or_else(|| Refusal::bad("nothing is being recorded"))
    }

    fn open(&mut self, open: &Open) -> Result<(), Refusal> {
        if !(16..=MAX_IMAGE).contains(&open.image) {
            return Err(Refusal::bad(format!(
                "images have 16 to {MAX_IMAGE} pixels a side, not {}",
                open.image
            )));
        }
        open.settings.values().try_for_each(|value| self.app.roots.check_json(value))?;
        let task = open.pair.as_ref().map(|pair| Task::read(self.app, pair)).transpose()?;
        let mut stage = Stage::open(&self.app.registry, open, task.as_ref())?;
        let policy = task.as_ref().and_then(|task| task.policy.clone());
        stage.set_policy(&self.app.registry, policy.clone())?;
        (self.is_playing, self.points) = (false, Vec::new());
        let hz = (1.0 / stage.world.spec().time_step_s).clamp(1.0, MAX_HZ);
        self.period = Duration::from_secs_f64(1.0 / hz);
        let about = json!({ "kind": "opened", "env": stage.entry.id, "hz": hz, "steer": stage.steer, "policy": policy.map(|policy| describe(&policy.name, &policy.named)) });
        self.stage = Some(stage);
        self.tell(&about);
        self.begun();
        Ok(())
    }

    fn record(&mut self, file: String, format: Option<String>, image: Option<usize>) -> Result<(), Refusal> {
        if let Some(recording) = &mut self.recording {
            recording.commit()?;
        }
        let path = self.app.roots.writable(&file)?;
        let side = image.unwrap_or(64);
        let image = ImageSize::new(side, side).map_err(Refusal::bad)?;
        self.recording = Some(Recording::begin(&self.app.registry, path, file, format, image)?);
        self.frame();
        Ok(())
    }

    /// One step of an environment that plays.
    fn tick(&mut self) -> Result<(), Refusal> {
        let now = Instant::now();
        if self.stage()?.is_over() {
            self.next_episode()?;
        } else {
            self.step()?;
        }
        // A slow environment does not catch up: it plays slower.
        self.next = (self.next + self.period).max(now);
        if self.stage()?.is_over() {
            self.next = now + PAUSE_AFTER_EPISODE;
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Refusal> {
        let stage = self.stage()?;
        if stage.is_over() {
            return self.next_episode();
        }
        stage.step()?;
        let (point, is_over, plan) = (stage.point(), stage.is_over(), stage.plan());
        self.points.push(point);
        if let Some(plan) = plan {
            self.tell(&plan);
        }
        if is_over && self.recording.is_some() {
            self.keep()?;
        }
        self.frame();
        Ok(())
    }

    fn next_episode(&mut self) -> Result<(), Refusal> {
        let registry = &self.app.registry;
        self.points.clear();
        self.stage()?.next_episode(registry)?;
        self.begun();
        Ok(())
    }

    /// Keeps the episode up to here.
    fn keep(&mut self) -> Result<(), Refusal> {
        let take = self.stage()?.take().ok_or_else(|| Refusal::bad("the episode has no step yet"))?;
        Ok(self.recording()?.keep(take)?)
    }

    /// Tells of a new episode: its factors, its first image.
    fn begun(&mut self) {
        let Some(stage) = &self.stage else { return };
        let about = json!({
            "kind": "episode",
            "seed": stage.seed,
            "episode": stage.episode,
            "factors": stage.factors(),
        });
        self.points.push(stage.point());
        self.tell(&about);
        if let Some((height, width, pixels)) = stage.goal() {
            let head = json!({ "goal": true, "height": height, "width": width });
            let _ = self.out.blocking_send(binary(&head, pixels));
        }
        self.frame();
    }

    /// Sends the episode up to here as a file. Nothing is written: the page keeps it where its user says.
    fn video(&mut self) -> Result<(), Refusal> {
        let stage = self.stage()?;
        let (height, width, _) = stage.image();
        let take = stage.take().ok_or_else(|| Refusal::bad("the episode has no step yet"))?;
        let (format, bytes) = take.video(ImageSize { height, width })?;
        let _ = self.out.blocking_send(binary(&json!({ "video": format.extension() }), &bytes));
        Ok(())
    }

    fn tell(&self, message: &impl Serialize) {
        let Ok(text) = serde_json::to_string(message) else { return };
        // The page may be gone, which the loop finds out.
        let _ = self.out.blocking_send(Message::Text(text.into()));
    }

    /// Sends the current image. A page that lags behind while the environment plays gets a later one.
    fn frame(&mut self) {
        let Some(stage) = &self.stage else { return };
        let (height, width, pixels) = stage.image();
        let end = stage.end();
        let head = json!({
            "height": height,
            "width": width,
            "playing": self.is_playing,
            "actor": stage.actor(),
            "episode": stage.episode,
            "step": end.map_or(0, |end| end.steps),
            "over": end.and_then(|end| match (end.terminated, end.truncated) {
                (true, _) => Some("terminated"),
                (_, true) => Some("truncated"),
                _ => None,
            }),
            "success": end.and_then(|end| end.success),
            "total_reward": end.map(|end| end.total_reward),
            "recording": self.recording.as_ref().map(|recording| {
                recording.status(self.app.roots.saved_id(&recording.name))
            }),
            "agent": stage.agent(),
            "points": self.points,
        });
        let may_skip = self.is_playing && end.is_some_and(|end| !end.terminated && !end.truncated);
        self.is_behind = may_skip && self.sent.saturating_sub(self.inbox.shown()) >= MAX_UNSEEN;
        if self.is_behind {
            return;
        }
        if self.out.blocking_send(binary(&head, pixels)).is_ok() {
            self.sent += 1;
            self.points.clear();
        }
    }
}

/// A head and an image `[H, W, 3]` as one message.
fn binary(head: &Json, pixels: &[u8]) -> Message {
    let head = head.to_string();
    let mut bytes = Vec::with_capacity(4 + head.len() + pixels.len());
    bytes.extend((head.len() as u32).to_le_bytes());
    bytes.extend(head.as_bytes());
    bytes.extend(pixels);
    Message::Binary(bytes.into())
}
