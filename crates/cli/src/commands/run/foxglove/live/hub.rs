//! Between the run and its clients: each has a queue of its own, which takes what it subscribed to and never fills up.

use super::protocol::{self, Subscription};
use crate::commands::run::foxglove::topics::Topic;
use cairn_sensor::Stamp;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

/// Bytes that may wait for a client: 20 images of 640x480, 4 s.
const MOST_BYTES: usize = 6 << 20;
/// Messages that may wait for it.
const MOST_MESSAGES: usize = 2000;

type Message = (Stamp, Arc<[u8]>);

/// All clients, and what those get who come later.
#[derive(Default)]
pub struct Hub(Mutex<State>);

#[derive(Default)]
struct State {
    kept: BTreeMap<Topic, Message>,
    clients: Vec<Arc<Client>>,
    /// Messages that clients lost who are gone.
    dropped: u64,
    has_ended: bool,
}

/// A client.
#[derive(Default)]
pub struct Client {
    queue: Mutex<Queue>,
    ready: Notify,
}

#[derive(Default)]
struct Queue {
    subscriptions: BTreeMap<Topic, u32>,
    time: Option<Stamp>,
    waiting: VecDeque<Waiting>,
    bytes: usize,
    dropped: u64,
    /// How many were dropped when the client was last warned.
    warned: u64,
    has_ended: bool,
}

enum Waiting {
    Message(u32, Message),
    Text(String),
}

impl Waiting {
    fn bytes(&self) -> usize {
        match self {
            Self::Message(_, (_, bytes)) => bytes.len(),
            Self::Text(text) => text.len(),
        }
    }
}

/// What is sent next.
#[derive(Debug, PartialEq)]
pub enum Outgoing {
    Text(String),
    Binary(Vec<u8>),
}

impl Hub {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a message of a topic is for anybody, now or later.
    pub fn wants(&self, topic: Topic) -> bool {
        topic.is_kept() || self.state().clients.iter().any(|c| c.queue().subscriptions.contains_key(&topic))
    }

    /// Gives a message to those who subscribed.
    pub fn put(&self, topic: Topic, stamp: Stamp, message: &[u8]) {
        let message = (stamp, Arc::from(message));
        let mut state = self.state();
        state.clients.iter().for_each(|c| c.offer(topic, &message));
        if topic.is_kept() {
            state.kept.insert(topic, message);
        }
    }

    /// Gives all the time of the run.
    pub fn time(&self, stamp: Stamp) {
        self.state().clients.iter().for_each(|c| c.change(|queue| queue.time = Some(stamp)));
    }

    /// A new client.
    pub fn join(&self) -> Arc<Client> {
        let (client, mut state) = (Arc::new(Client::default()), self.state());
        client.queue().has_ended = state.has_ended;
        state.clients.push(client.clone());
        client
    }

    /// A client is gone.
    pub fn leave(&self, client: &Arc<Client>) {
        let mut state = self.state();
        state.clients.retain(|c| !Arc::ptr_eq(c, client));
        state.dropped += client.queue().dropped;
    }

    /// Subscribes a client, which gets the last message at once where it is kept; an unknown or second one is refused.
    pub fn subscribe(&self, client: &Client, Subscription { id, channel_id }: Subscription) {
        let state = self.state();
        let topic = Topic::ALL.get(channel_id);
        client.change(|queue| {
            let is_known = queue.subscriptions.values().any(|known| *known == id);
            match topic.filter(|topic| !is_known && !queue.subscriptions.contains_key(topic)) {
                None => queue.push(Waiting::Text(protocol::warning(&format!(
                    "subscription {id} to channel {channel_id} is refused: the channel is unknown, or one of the two is in use"
                )))),
                Some(topic) => {
                    queue.subscriptions.insert(*topic, id);
                    if let Some(message) = state.kept.get(topic) {
                        queue.push(Waiting::Message(id, message.clone()));
                    }
                }
            }
        });
    }

    /// There are no more messages: clients get what waits, and are then done.
    pub fn end(&self) {
        let mut state = self.state();
        state.has_ended = true;
        state.clients.iter().for_each(|c| c.change(|queue| queue.has_ended = true));
    }

    /// How many messages were dropped because clients did not keep up.
    pub fn dropped(&self) -> u64 {
        let state = self.state();
        state.dropped + state.clients.iter().map(|c| c.queue().dropped).sum::<u64>()
    }
}

impl Client {
    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut Queue)) {
        change(&mut self.queue());
        self.ready.notify_one();
    }

    fn offer(&self, topic: Topic, message: &Message) {
        let subscription = self.queue().subscriptions.get(&topic).copied();
        if let Some(id) = subscription {
            self.change(|queue| queue.push(Waiting::Message(id, message.clone())));
        }
    }

    /// Ends subscriptions.
    pub fn unsubscribe(&self, ids: &[u32]) {
        self.queue().subscriptions.retain(|_, id| !ids.contains(id));
    }

    /// Warns whoever looks at the client.
    pub fn warn(&self, text: &str) {
        self.change(|queue| queue.push(Waiting::Text(protocol::warning(text))));
    }

    /// What is sent next, when there is something; `None` after the end.
    pub async fn next(&self) -> Option<Outgoing> {
        loop {
            let ready = self.ready.notified();
            {
                let mut queue = self.queue();
                if let Some(outgoing) = queue.next() {
                    return Some(outgoing);
                }
                if queue.has_ended {
                    return None;
                }
            }
            ready.await;
        }
    }
}

impl Queue {
    /// Appends, and drops the oldest where too many wait.
    fn push(&mut self, waiting: Waiting) {
        self.bytes += waiting.bytes();
        self.waiting.push_back(waiting);
        while self.waiting.len() > 1 && (self.bytes > MOST_BYTES || self.waiting.len() > MOST_MESSAGES) {
            self.bytes -= self.waiting.pop_front().map_or(0, |oldest| oldest.bytes());
            self.dropped += 1;
        }
    }

    fn next(&mut self) -> Option<Outgoing> {
        if self.dropped > 2 * self.warned {
            self.warned = self.dropped;
            let text =
                format!("{} messages were dropped: this connection is slower than the run", self.dropped);
            return Some(Outgoing::Text(protocol::warning(&text)));
        }
        if let Some(stamp) = self.time.take() {
            return Some(Outgoing::Binary(protocol::time(stamp)));
        }
        let waiting = self.waiting.pop_front()?;
        self.bytes -= waiting.bytes();
        Some(match waiting {
            Waiting::Text(text) => Outgoing::Text(text),
            Waiting::Message(id, (stamp, bytes)) => {
                Outgoing::Binary(protocol::message_data(id, stamp, &bytes))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What waits for a client.
    fn waiting(client: &Client) -> Vec<Outgoing> {
        std::iter::from_fn(|| client.queue().next()).collect()
    }

    fn data(id: u32, stamp: i64, bytes: &[u8]) -> Outgoing {
        Outgoing::Binary(protocol::message_data(id, Stamp(stamp), bytes))
    }

    const fn to(topic: Topic, id: u32) -> Subscription {
        Subscription { id, channel_id: topic as usize }
    }

    #[test]
    fn who_comes_later_gets_what_is_kept_and_what_comes() {
        let hub = Hub::default();
        assert!(hub.wants(Topic::Tf) && !hub.wants(Topic::Image));
        hub.put(Topic::Tf, Stamp(1), b"old");
        hub.put(Topic::Tf, Stamp(2), b"last");
        hub.put(Topic::Pose, Stamp(2), b"gone");
        let client = hub.join();
        [to(Topic::Tf, 7), to(Topic::Pose, 8)].into_iter().for_each(|s| hub.subscribe(&client, s));
        assert!(hub.wants(Topic::Pose));
        hub.put(Topic::Pose, Stamp(3), b"new");
        hub.put(Topic::Image, Stamp(3), b"nobody's");
        assert_eq!(waiting(&client), [data(7, 2, b"last"), data(8, 3, b"new")]);
        client.unsubscribe(&[8]);
        hub.put(Topic::Pose, Stamp(4), b"no longer");
        hub.time(Stamp(4));
        hub.time(Stamp(5));
        assert_eq!(waiting(&client), [Outgoing::Binary(protocol::time(Stamp(5)))], "only the latest time");
        for wrong in [to(Topic::Tf, 9), to(Topic::Said, 7), Subscription { id: 9, channel_id: 99 }] {
            hub.subscribe(&client, wrong);
            let refused = waiting(&client);
            assert!(
                matches!(&refused[..], [Outgoing::Text(text)] if text.contains("is refused")),
                "{refused:?}"
            );
        }
    }

    #[test]
    fn a_client_that_hangs_loses_the_oldest_and_holds_nothing_up() {
        let hub = Hub::default();
        let (slow, other) = (hub.join(), hub.join());
        hub.subscribe(&slow, to(Topic::Image, 1));
        hub.subscribe(&other, to(Topic::Image, 1));
        let image = vec![0; MOST_BYTES / 4];
        for i in 0..10 {
            hub.put(Topic::Image, Stamp(i), &image);
            assert_eq!(waiting(&other).len(), 1);
        }
        assert!(slow.queue().bytes <= MOST_BYTES);
        let left = waiting(&slow);
        assert!(
            matches!(&left[0], Outgoing::Text(text) if text.contains("6 messages were dropped")),
            "{:?}",
            left[0]
        );
        assert_eq!((left.len(), &left[1], &left[4]), (5, &data(1, 6, &image), &data(1, 9, &image)));
        (0..MOST_MESSAGES as i64 + 3).for_each(|i| hub.put(Topic::Image, Stamp(i), b""));
        assert_eq!(slow.queue().waiting.len(), MOST_MESSAGES);
        hub.leave(&slow);
        waiting(&other);
        assert_eq!(hub.dropped(), 6 + 3 + 3);
    }

    #[test]
    fn after_the_end_what_waits_is_still_sent() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let hub = Hub::default();
        let client = hub.join();
        hub.subscribe(&client, to(Topic::Said, 1));
        hub.put(Topic::Said, Stamp(1), b"a");
        hub.end();
        let left = runtime.block_on(async { [client.next().await, client.next().await] });
        assert_eq!(left, [Some(data(1, 1, b"a")), None]);
        assert_eq!(runtime.block_on(hub.join().next()), None, "nobody comes after the end");
    }
}
