//! A line: the connection to a page that cannot open a web socket. Its requests put messages in at one end, in order and
//! each once, and the page's task takes them out at the other; what it sends is framed for the request that streams.
//! All queues are bounded.

use axum::body::Bytes;
use axum::extract::ws::Message;
use axum::http::StatusCode;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::mpsc;

/// Lines that may be open at a time.
const MOST_LINES: usize = 32;
/// Texts that may wait for the page's task, and pictures: one is under way, and its answer may be lost.
const TEXTS: usize = 512;
const PICTURES: usize = 2;
/// Frames that may wait for the stream.
const FRAMES: usize = 4;
/// Requests of texts that may come before an earlier one.
const AHEAD: u64 = 8;

/// The open lines, by their names.
#[derive(Default)]
pub(crate) struct Lines(Mutex<HashMap<String, Arc<Line>>>);

impl Lines {
    /// Opens a line under a name; `None` where too many are open.
    pub fn open(&self, name: &str) -> Option<Requests> {
        let mut lines = self.all();
        let (line, end) = (lines.len() < MOST_LINES).then(line)?;
        lines.insert(name.to_owned(), Arc::new(line));
        Some(end)
    }

    /// The line of this name.
    pub fn find(&self, name: &str) -> Result<Arc<Line>, StatusCode> {
        self.all().get(name).cloned().ok_or(StatusCode::GONE)
    }

    /// Closes a line.
    pub fn close(&self, name: &str) {
        self.all().remove(name);
    }

    fn all(&self) -> MutexGuard<'_, HashMap<String, Arc<Line>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The server's end of a line, as its requests see it.
pub(crate) struct Line {
    state: Mutex<Arriving>,
    texts: mpsc::Sender<Message>,
    pictures: mpsc::Sender<Message>,
    /// Taken by the request that streams.
    down: Mutex<Option<mpsc::Receiver<Bytes>>>,
}

/// What arrives, put in order.
#[derive(Default)]
struct Arriving {
    next_texts: u64,
    early: BTreeMap<u64, Vec<Message>>,
    next_picture: u64,
}

/// The other end, as the page's task sees it.
pub(crate) struct Requests {
    texts: mpsc::Receiver<Message>,
    pictures: mpsc::Receiver<Message>,
    down: mpsc::Sender<Bytes>,
    sent: u32,
}

impl Requests {
    /// The next message; `None` at the end.
    pub async fn recv(&mut self) -> Option<Message> {
        tokio::select! {
            biased;
            text = self.texts.recv() => text,
            Some(picture) = self.pictures.recv() => Some(picture),
        }
    }

    /// Sends a message; false when the page is gone.
    pub async fn send(&mut self, message: Message) -> bool {
        let framed = match &message {
            Message::Text(text) => frame(1, self.sent, text.as_bytes()),
            Message::Binary(bytes) => frame(2, self.sent, bytes),
            _ => return true,
        };
        self.sent = self.sent.wrapping_add(1);
        self.down.send(framed).await.is_ok()
    }
}

/// What the stream sends: length, kind (0 nothing, 1 text, 2 binary), number, payload.
pub(crate) fn frame(kind: u8, number: u32, payload: &[u8]) -> Bytes {
    let length = (payload.len() as u32).to_le_bytes();
    [&length[..], &[kind], &number.to_le_bytes(), payload].concat().into()
}

/// A line and its other end.
fn line() -> (Line, Requests) {
    let (texts, texts_end) = mpsc::channel(TEXTS);
    let (pictures, pictures_end) = mpsc::channel(PICTURES);
    let (down, down_end) = mpsc::channel(FRAMES);
    let line = Line { state: Mutex::default(), texts, pictures, down: Mutex::new(Some(down_end)) };
    (line, Requests { texts: texts_end, pictures: pictures_end, down, sent: 0 })
}

impl Line {
    /// Takes the texts of a request: those that come again are dropped, those that come early wait.
    pub fn texts(&self, number: u64, body: &str) -> StatusCode {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if number < state.next_texts {
            return StatusCode::NO_CONTENT;
        }
        if number - state.next_texts >= AHEAD {
            return StatusCode::TOO_MANY_REQUESTS;
        }
        state.early.insert(number, body.lines().map(|line| Message::Text(line.into())).collect());
        loop {
            let next = state.next_texts;
            let Some(batch) = state.early.remove(&next) else { return StatusCode::NO_CONTENT };
            state.next_texts += 1;
            if batch.into_iter().any(|text| self.texts.try_send(text).is_err()) {
                return StatusCode::GONE;
            }
        }
    }

    /// What goes to the page, given once.
    pub fn down(&self) -> Option<mpsc::Receiver<Bytes>> {
        self.down.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Takes a picture, if it is newer than the last.
    pub fn picture(&self, number: u64, bytes: Bytes) -> StatusCode {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if number < state.next_picture {
            return StatusCode::NO_CONTENT;
        }
        state.next_picture = number.saturating_add(1);
        match self.pictures.try_send(Message::Binary(bytes)) {
            Ok(()) => StatusCode::NO_CONTENT,
            Err(mpsc::error::TrySendError::Full(_)) => StatusCode::TOO_MANY_REQUESTS,
            Err(mpsc::error::TrySendError::Closed(_)) => StatusCode::GONE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waiting(end: &mut Requests) -> Vec<String> {
        let texts = std::iter::from_fn(|| end.texts.try_recv().ok());
        texts.map(|m| m.into_text().unwrap().to_string()).collect()
    }

    #[test]
    fn texts_are_taken_once_and_in_order() {
        let (line, mut end) = line();
        assert_eq!(line.texts(1, "c\nd"), StatusCode::NO_CONTENT);
        assert_eq!(waiting(&mut end), Vec::<String>::new(), "the one before is missing");
        line.texts(0, "a\nb");
        assert_eq!(waiting(&mut end), ["a", "b", "c", "d"]);
        line.texts(0, "a\nb");
        line.texts(1, "c\nd");
        assert_eq!(waiting(&mut end), Vec::<String>::new(), "they came again");
        assert_eq!(line.texts(2 + AHEAD, "x"), StatusCode::TOO_MANY_REQUESTS);
        line.texts(3, "f");
        line.texts(3, "f");
        line.texts(2, "e");
        assert_eq!(waiting(&mut end), ["e", "f"]);
        // A page that floods is not kept.
        let flood = "x\n".repeat(TEXTS + 1);
        assert_eq!(line.texts(4, &flood), StatusCode::GONE);
    }

    #[test]
    fn pictures_are_bounded_and_old_ones_dropped() {
        let (line, mut end) = line();
        let send = |n: u64| line.picture(n, Bytes::from(vec![n as u8]));
        assert_eq!([send(0), send(0), send(2), send(1)], [StatusCode::NO_CONTENT; 4]);
        let taken = std::iter::from_fn(|| end.pictures.try_recv().ok());
        assert_eq!(taken.map(|m| m.into_data()[0]).collect::<Vec<_>>(), [0, 2]);
        assert_eq!([send(3), send(4), send(5)].map(|s| s.is_success()), [true, true, false]);
        assert_eq!(send(u64::MAX), StatusCode::TOO_MANY_REQUESTS);
        drop(end);
        let (line, end) = super::line();
        drop(end);
        assert_eq!(line.picture(0, Bytes::new()), StatusCode::GONE);
    }
}
