//! Places for connections. Who has not shown the access token yet is a stranger: strangers have a share of the places, each
//! address a part of that, and where none is left the oldest of the busiest address goes. So nobody without the token
//! keeps out the walker's phone, however many connections are held open; who has shown it keeps the place.

use std::net::IpAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// A stranger's connection lasts no longer: a page loads its files in less, over a slow network too.
const STRANGER_FOR: Duration = Duration::from_secs(60);

/// The places of a server.
#[derive(Clone)]
pub(crate) struct Places(Arc<Shared>);

struct Shared {
    /// The most strangers, the most of one address, and the most who have shown the token.
    strangers: usize,
    of_address: usize,
    guests: usize,
    taken: Mutex<Taken>,
}

#[derive(Default)]
struct Taken {
    next: u64,
    /// Oldest first.
    strangers: Vec<Stranger>,
    guests: usize,
}

struct Stranger {
    id: u64,
    from: IpAddr,
    leave: Arc<Notify>,
}

/// The place of one connection, free again when dropped.
pub(crate) struct Place {
    id: u64,
    places: Places,
    leave: Arc<Notify>,
    is_guest: AtomicBool,
}

impl Places {
    /// As many in all: half for strangers, and half of those for one address.
    pub fn new(connections: usize) -> Self {
        let strangers = (connections / 2).max(1);
        let (of_address, guests) = ((strangers / 2).max(1), (connections - connections / 2).max(1));
        Self(Arc::new(Shared { strangers, of_address, guests, taken: Mutex::default() }))
    }

    /// A place for a connection from this address; a stranger may have to leave for it.
    pub fn take(&self, from: IpAddr) -> Place {
        let mut taken = self.taken();
        let of = |taken: &Taken, from| taken.strangers.iter().filter(|s| s.from == from).count();
        if of(&taken, from) >= self.0.of_address {
            taken.send_off(from);
        } else if taken.strangers.len() >= self.0.strangers {
            let busiest = taken.strangers.iter().map(|s| s.from).max_by_key(|from| of(&taken, *from));
            busiest.iter().for_each(|from| taken.send_off(*from));
        }
        let (id, leave) = (taken.next, Arc::new(Notify::new()));
        taken.next += 1;
        taken.strangers.push(Stranger { id, from, leave: leave.clone() });
        Place { id, places: self.clone(), leave, is_guest: AtomicBool::new(false) }
    }

    /// The oldest stranger leaves: the system has no descriptor left.
    pub fn make_room(&self) {
        let mut taken = self.taken();
        if let Some(from) = taken.strangers.first().map(|s| s.from) {
            taken.send_off(from);
        }
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        self.0.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Taken {
    /// The oldest stranger of an address leaves.
    fn send_off(&mut self, from: IpAddr) {
        if let Some(at) = self.strangers.iter().position(|s| s.from == from) {
            self.strangers.remove(at).leave.notify_one();
        }
    }
}

impl Place {
    /// The token was shown on this connection, which keeps its place from now on; false where that is too late, or too many
    /// have one.
    pub fn keep(&self) -> bool {
        if self.is_guest.load(Ordering::Relaxed) {
            return true;
        }
        let mut taken = self.places.taken();
        let Some(at) = taken.strangers.iter().position(|s| s.id == self.id) else {
            return self.is_guest.load(Ordering::Relaxed);
        };
        if taken.guests >= self.places.0.guests {
            return false;
        }
        taken.strangers.remove(at);
        taken.guests += 1;
        self.is_guest.store(true, Ordering::Relaxed);
        true
    }

    /// Waits until the connection has to end, which it never has to once its place is kept.
    pub async fn has_to_leave(&self) {
        tokio::select! {
            () = self.leave.notified() => {}
            () = tokio::time::sleep(STRANGER_FOR) => {
                if self.is_guest.load(Ordering::Relaxed) {
                    std::future::pending().await
                }
            }
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken();
        match *self.is_guest.get_mut() {
            true => taken.guests -= 1,
            false => taken.strangers.retain(|s| s.id != self.id),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(n: u8) -> IpAddr {
        [10, 0, 0, n].into()
    }

    /// The addresses of the strangers, oldest first.
    fn strangers(places: &Places) -> Vec<IpAddr> {
        places.taken().strangers.iter().map(|s| s.from).collect()
    }

    #[test]
    fn one_address_takes_a_part_and_a_new_connection_always_gets_a_place() {
        let places = Places::new(16);
        let one: Vec<Place> = (0..10).map(|_| places.take(address(1))).collect();
        assert_eq!(strangers(&places).len(), 4, "a quarter of all");
        assert!(!one[5].keep() && one[6].keep(), "the oldest had to leave");
        let two: Vec<Place> = (0..3).map(|_| places.take(address(2))).collect();
        let others: Vec<Place> = (3..7).map(|n| places.take(address(n))).collect();
        // The busiest gives way, not whoever has one connection.
        assert_eq!(strangers(&places).len(), 8);
        assert!(others.iter().all(Place::keep) && two.last().unwrap().keep());
        drop((one, two, others));
        let taken = places.taken();
        assert_eq!((taken.strangers.len(), taken.guests), (0, 0));
    }

    #[test]
    fn who_has_shown_the_token_is_never_sent_off_and_they_are_bounded_too() {
        let places = Places::new(8);
        let kept: Vec<Place> = (0..4).map(|_| places.take(address(1))).filter(Place::keep).collect();
        assert_eq!(kept.len(), 4);
        let strangers: Vec<Place> = (0..50).map(|n| places.take(address(n))).collect();
        assert!(kept.iter().all(Place::keep));
        assert!(!strangers.last().unwrap().keep(), "half of the places");
        drop(kept);
        assert!(strangers.last().unwrap().keep());
    }
}
