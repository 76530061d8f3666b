//! Messages that wait for the thread of a session. Of those that only the last one counts of, only the last one waits.

use std::collections::VecDeque;
use std::mem::discriminant;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Instant;

use super::message::Command;

/// So many messages may wait: a page sends some per frame, and a planner may take seconds.
const MAX_WAITING: usize = 256;

#[derive(Default)]
pub(super) struct Inbox {
    state: Mutex<State>,
    arrived: Condvar,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Result<Command, String>>,
    /// Frames that the page has shown.
    shown: u64,
    is_closed: bool,
}

impl Inbox {
    /// Takes a message; false: too many wait.
    pub(super) fn push(&self, text: &str) -> bool {
        let command =
            serde_json::from_str::<Command>(text).map_err(|error| format!("the page sent `{error}`"));
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Ok(Command::Shown) = command {
            state.shown += 1;
        }
        if let (Ok(new), Some(Ok(last))) = (&command, state.waiting.back())
            && discriminant(new) == discriminant(last)
            && matches!(
                new,
                Command::Action { .. }
                    | Command::Pointer { .. }
                    | Command::Rewind { .. }
                    | Command::Reset(_)
                    | Command::Rate { .. }
                    | Command::Shown
            )
        {
            state.waiting.pop_back();
        }
        state.waiting.push_back(command);
        self.arrived.notify_one();
        state.waiting.len() <= MAX_WAITING
    }

    /// How many frames the page has shown.
    pub(super) fn shown(&self) -> u64 {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).shown
    }

    /// The page is gone.
    pub(super) fn close(&self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).is_closed = true;
        self.arrived.notify_one();
    }

    /// The next message, once there is one or it is `until`; `Err`: the page is gone.
    pub(super) fn next(&self, until: Option<Instant>) -> Result<Option<Result<Command, String>>, Closed> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if state.is_closed {
                return Err(Closed);
            }
            if let Some(command) = state.waiting.pop_front() {
                return Ok(Some(command));
            }
            state = match until.map(|until| until.saturating_duration_since(Instant::now())) {
                None => self.arrived.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(left) if left.is_zero() => return Ok(None),
                Some(left) => {
                    self.arrived.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }
}

/// The page is gone.
pub(super) struct Closed;

#[cfg(test)]
mod tests {
    use super::*;

    fn next(inbox: &Inbox) -> Option<Result<Command, String>> {
        inbox.next(Some(Instant::now())).ok().expect("it is open")
    }

    #[test]
    fn only_the_last_of_many_pointer_positions_waits() {
        let inbox = Inbox::default();
        for x in 0..1000 {
            assert!(inbox.push(&format!(r#"{{"type":"pointer","at":[{x},0]}}"#)));
        }
        assert!(inbox.push(r#"{"type":"step"}"#));
        let Some(Ok(Command::Pointer { at: Some([x, _]) })) = next(&inbox) else { panic!("a position") };
        assert_eq!(x, 999.0);
        assert!(matches!(next(&inbox), Some(Ok(Command::Step))));
        assert!(next(&inbox).is_none());
    }

    #[test]
    fn shown_frames_are_counted_and_one_word_of_them_waits() {
        let inbox = Inbox::default();
        assert!((0..1000).all(|_| inbox.push(r#"{"type":"shown"}"#)));
        assert_eq!(inbox.shown(), 1000);
        assert!(matches!(next(&inbox), Some(Ok(Command::Shown))));
        assert!(next(&inbox).is_none());
    }

    #[test]
    fn a_flood_of_messages_is_refused() {
        let inbox = Inbox::default();
        assert!((0..MAX_WAITING).all(|_| inbox.push(r#"{"type":"step"}"#)));
        assert!(!inbox.push(r#"{"type":"step"}"#));
    }

    #[test]
    fn what_is_no_command_is_said() {
        let inbox = Inbox::default();
        inbox.push(r#"{"type":"format_disk"}"#);
        let Some(Err(reason)) = next(&inbox) else { panic!("an error") };
        assert!(reason.contains("format_disk"), "{reason}");
        inbox.close();
        assert!(inbox.next(None).is_err());
    }
}
