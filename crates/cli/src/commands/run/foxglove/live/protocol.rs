//! Foxglove's web socket protocol (github.com/foxglove/ws-protocol, docs/spec.md): what is sent and understood of it.
//!
//! Text is JSON with the kind of message in `op`, binary begins with a byte for the kind. Clients may only subscribe.

use crate::commands::run::foxglove::topics::Topic;
use cairn_sensor::Stamp;
use serde::Deserialize;
use serde_json::json;
use std::time::SystemTime;

/// The protocol under the names of its two versions, which are the same in what is used here.
pub const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

const MESSAGE_DATA: u8 = 1;
const TIME: u8 = 2;

/// The first message: who this is. Clients use the time that is sent, and begin anew where the session has another id.
pub fn server_info() -> String {
    let began = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_nanos());
    json!({
        "op": "serverInfo",
        "name": concat!("cairn ", env!("CARGO_PKG_VERSION")),
        "capabilities": ["time"],
        "supportedEncodings": [],
        "metadata": {},
        "sessionId": began.to_string(),
    })
    .to_string()
}

/// All topics.
pub fn advertise() -> String {
    let channel = |topic: &Topic| {
        let (name, schema) = topic.channel();
        json!({
            "id": *topic as usize,
            "topic": name,
            "encoding": "cdr",
            "schemaName": schema.name,
            "schema": schema.text(),
            "schemaEncoding": "ros2msg",
        })
    };
    json!({ "op": "advertise", "channels": Topic::ALL.iter().map(channel).collect::<Vec<_>>() }).to_string()
}

/// A warning for whoever looks at the client.
pub fn warning(message: &str) -> String {
    json!({ "op": "status", "level": 1, "message": message }).to_string()
}

/// A message of a topic.
pub fn message_data(subscription: u32, stamp: Stamp, message: &[u8]) -> Vec<u8> {
    let stamp = (stamp.0.max(0) as u64).to_le_bytes();
    [&[MESSAGE_DATA][..], &subscription.to_le_bytes(), &stamp, message].concat()
}

/// The time of the run.
pub fn time(stamp: Stamp) -> Vec<u8> {
    [&[TIME][..], &(stamp.0.max(0) as u64).to_le_bytes()].concat()
}

/// What a client asks for.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub enum Request {
    /// The messages of some topics.
    Subscribe { subscriptions: Vec<Subscription> },
    /// No longer those of some subscriptions.
    Unsubscribe { subscription_ids: Vec<u32> },
    /// Something that was not offered.
    #[serde(other)]
    Other,
}

/// A client's name for the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Subscription {
    pub id: u32,
    pub channel_id: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_as_the_specification_writes_them() {
        let read = |text: &str| serde_json::from_str::<Request>(text).ok();
        let subscriptions =
            vec![Subscription { id: 0, channel_id: 3 }, Subscription { id: 1, channel_id: 5 }];
        let text = r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":3},{"id":1,"channelId":5}]}"#;
        assert_eq!(read(text), Some(Request::Subscribe { subscriptions }));
        let gone = read(r#"{"op":"unsubscribe","subscriptionIds":[0,1]}"#);
        assert_eq!(gone, Some(Request::Unsubscribe { subscription_ids: vec![0, 1] }));
        assert_eq!(read(r#"{"op":"getParameters","parameterNames":[]}"#), Some(Request::Other));
        for wrong in
            ["", "{}", "[]", r#"{"op":"subscribe"}"#, r#"{"op":"subscribe","subscriptions":[{"id":-1}]}"#]
        {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn binary_messages_have_the_layout_of_the_specification() {
        let data = message_data(0x0102_0304, Stamp(5), b"ab");
        assert_eq!(data, [1, 4, 3, 2, 1, 5, 0, 0, 0, 0, 0, 0, 0, b'a', b'b']);
        assert_eq!(time(Stamp(-7)), [2, 0, 0, 0, 0, 0, 0, 0, 0], "there is no time before zero");
    }
}
