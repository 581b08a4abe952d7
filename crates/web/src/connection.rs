//! The way messages go to a page and come from it: a web socket, or plain requests where the browser refuses one.

use crate::line::Requests;
use axum::extract::ws::{Message, WebSocket};

/// A connection to one page; its protocol is the same either way.
pub(crate) enum Connection {
    Socket(Box<WebSocket>),
    Requests(Requests),
}

impl Connection {
    /// The next message; `None` at the end. May be cancelled without losing one.
    pub async fn recv(&mut self) -> Option<Message> {
        match self {
            Self::Socket(socket) => socket.recv().await?.ok(),
            Self::Requests(requests) => requests.recv().await,
        }
    }

    /// Sends a message; false when the page is gone.
    pub async fn send(&mut self, message: Message) -> bool {
        match self {
            Self::Socket(socket) => socket.send(message).await.is_ok(),
            Self::Requests(requests) => requests.send(message).await,
        }
    }
}
