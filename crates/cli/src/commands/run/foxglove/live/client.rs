//! One client: the handshake, its requests, and what is sent to it.

use super::hub::{Client, Hub, Outgoing};
use super::protocol::{self, PROTOCOLS, Request};
use futures_util::{SinkExt, StreamExt};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio_tungstenite::accept_hdr_async_with_config;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::handshake::server;
use tokio_tungstenite::tungstenite::http::header::{HeaderValue, ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::tungstenite::http::{HeaderMap, StatusCode};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;

/// How long a handshake may take.
const HANDSHAKE: Duration = Duration::from_secs(5);
/// A request is not longer than this: 11 subscriptions are 500 bytes.
const MOST_REQUEST: usize = 1 << 16;

/// Serves a client until it leaves or the run has ended.
pub async fn serve(stream: TcpStream, hub: Arc<Hub>) {
    // Messages are whole when they are written: nothing is gained by waiting for more.
    let _ = stream.set_nodelay(true);
    let config =
        WebSocketConfig::default().max_message_size(Some(MOST_REQUEST)).max_frame_size(Some(MOST_REQUEST));
    let handshake = accept_hdr_async_with_config(stream, negotiate, Some(config));
    let Ok(Ok(socket)) = tokio::time::timeout(HANDSHAKE, handshake).await else { return };
    let (mut to, mut from) = socket.split();
    let client = hub.join();
    let sending = async {
        to.send(Message::text(protocol::server_info())).await?;
        to.send(Message::text(protocol::advertise())).await?;
        while let Some(outgoing) = client.next().await {
            let message = match outgoing {
                Outgoing::Text(text) => Message::text(text),
                Outgoing::Binary(bytes) => Message::binary(bytes),
            };
            to.send(message).await?;
        }
        to.close().await
    };
    let mut receiving = pin!(async {
        while let Some(Ok(message)) = from.next().await {
            match message {
                Message::Text(text) => understand(&hub, &client, &text),
                Message::Close(_) => break,
                _ => {}
            }
        }
    });
    tokio::select! {
        // After the last message its own farewell is waited for, lest the system forgets what it has not read yet. A connection
        // that breaks is a client that has left.
        sent = sending => if sent.is_ok() {
            receiving.await;
        },
        () = &mut receiving => {}
    }
    hub.leave(&client);
}

fn understand(hub: &Hub, client: &Client, text: &str) {
    match serde_json::from_str(text) {
        Ok(Request::Subscribe { subscriptions }) => {
            subscriptions.into_iter().for_each(|s| hub.subscribe(client, s));
        }
        Ok(Request::Unsubscribe { subscription_ids }) => client.unsubscribe(&subscription_ids),
        Ok(Request::Other) => client.warn("only subscriptions are offered"),
        Err(why) => client.warn(&format!("a request is not understood: {why}")),
    }
}

/// Answers a handshake.
#[expect(clippy::result_large_err, reason = "the type of the library's callback")]
fn negotiate(
    request: &server::Request,
    mut response: server::Response,
) -> Result<server::Response, server::ErrorResponse> {
    match admitted(request.headers()) {
        Ok(protocol) => {
            response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(protocol));
            Ok(response)
        }
        Err((status, why)) => {
            let mut response = server::ErrorResponse::new(Some(why.to_owned()));
            *response.status_mut() = status;
            Err(response)
        }
    }
}

/// The version of the protocol to speak; clients that know none and pages of strangers are refused.
fn admitted(headers: &HeaderMap) -> Result<&'static str, (StatusCode, &'static str)> {
    if !is_welcome(headers) {
        return Err((StatusCode::FORBIDDEN, "pages of other sites may not see what this camera sees"));
    }
    let why = "this is for clients of foxglove.sdk.v1 and foxglove.websocket.v1";
    protocol_of(headers).ok_or((StatusCode::BAD_REQUEST, why))
}

/// The version that a client likes best of those that are known.
fn protocol_of(headers: &HeaderMap) -> Option<&'static str> {
    let offered = headers.get_all(SEC_WEBSOCKET_PROTOCOL).into_iter().filter_map(|v| v.to_str().ok());
    let mut offered = offered.flat_map(|names| names.split(',')).map(str::trim);
    offered.find_map(|name| PROTOCOLS.into_iter().find(|known| *known == name))
}

/// Any page that a browser shows can connect to this machine: only Foxglove's, those of this machine, and programs that are
/// no page are let in.
fn is_welcome(headers: &HeaderMap) -> bool {
    let Some(origin) = headers.get(ORIGIN) else { return true };
    let Ok(origin) = origin.to_str() else { return false };
    let Some(place) = ["https://", "http://"].iter().find_map(|scheme| origin.strip_prefix(scheme)) else {
        return origin != "null";
    };
    let host = match place.strip_prefix('[') {
        Some(v6) => v6.split(']').next(),
        None => place.split(':').next(),
    };
    host.is_some_and(|host| {
        ["localhost", "127.0.0.1", "::1", "foxglove.dev"].contains(&host) || host.ends_with(".foxglove.dev")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(name: tokio_tungstenite::tungstenite::http::HeaderName, value: &str) -> HeaderMap {
        HeaderMap::from_iter([(name, HeaderValue::from_str(value).unwrap())])
    }

    #[test]
    fn the_first_known_protocol_is_chosen() {
        let chosen = |offered: &str| protocol_of(&with(SEC_WEBSOCKET_PROTOCOL, offered));
        assert_eq!(chosen("foxglove.websocket.v1"), Some("foxglove.websocket.v1"));
        assert_eq!(chosen("foxglove.sdk.v2, foxglove.sdk.v1,foxglove.websocket.v1"), Some("foxglove.sdk.v1"));
        assert_eq!((chosen("chat"), protocol_of(&HeaderMap::new())), (None, None));
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let welcome = |origin: &str| is_welcome(&with(ORIGIN, origin));
        assert!(is_welcome(&HeaderMap::new()), "a program that is no page");
        for origin in ["https://app.foxglove.dev", "http://localhost:8080", "http://[::1]:80", "file://"] {
            assert!(welcome(origin), "{origin}");
        }
        for origin in
            ["https://example.com", "https://notfoxglove.dev", "https://foxglove.dev.example.com", "null"]
        {
            assert!(!welcome(origin), "{origin}");
        }
    }
}
