//! Tells machines that multicast does not reach of this node (`ROS_STATIC_PEERS`).
//!
//! The DDS library announces a participant by multicast and to the first ports of this machine alone. What it sends to one of these
//! ports is passed on as it is to the ports on which the participants of each peer wait for announcements (RTPS 2.5, 9.6.2.3). An
//! announcement says where its participant is reached, so that the peer answers to that, and both know each other.

use std::io::{Error, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::time::Duration;

/// Participants of a machine that are told: numbers from 0, as CycloneDDS and Fast DDS give them.
const PARTICIPANTS: u16 = 32;
/// The first ports of this machine to which the library announces.
const ANNOUNCED: std::ops::Range<u16> = 0..12;
/// Bytes of the head of a message, which begins with the protocol's name and ends with the sender's prefix.
const HEAD: usize = 20;
/// The last announcement is repeated after this: a peer may have been switched on since. The library announces every ten seconds.
const REPEAT: Duration = Duration::from_secs(1);

/// The port on which participant `number` of a domain waits for announcements.
fn port(domain: u16, number: u16) -> Option<u16> {
    7410u16.checked_add(domain.checked_mul(250)?)?.checked_add(2 * number)
}

/// Whether a message comes from the participant of this prefix.
fn is_of(message: &[u8], prefix: &[u8]) -> bool {
    message.len() > HEAD && message.starts_with(b"RTPS") && &message[8..HEAD] == prefix
}

/// Passes announcements on.
#[derive(Debug)]
pub struct Announcer {
    from: UdpSocket,
    to: UdpSocket,
    prefix: Vec<u8>,
    peers: Vec<SocketAddr>,
}

impl Announcer {
    /// For the participant of this prefix, and peers by name or address.
    ///
    /// # Errors
    /// A peer that has no address, a domain that is none, no free port.
    pub fn new(domain: u16, prefix: Vec<u8>, peers: &[String]) -> std::io::Result<Self> {
        let wrong = |why: String| Error::new(ErrorKind::InvalidInput, why);
        let mut addresses = Vec::new();
        for peer in peers {
            let found = (peer.as_str(), 0).to_socket_addrs().map_err(|e| wrong(format!("{peer}: {e}")))?;
            addresses.extend(found.filter(SocketAddr::is_ipv4));
        }
        if addresses.is_empty() {
            return Err(wrong("no peer has an IPv4 address".into()));
        }
        // The last of the ports, which the participants of this machine take last.
        let ports = ANNOUNCED.rev().filter_map(|number| port(domain, number));
        let from = ports.into_iter().find_map(|port| UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).ok());
        let from = from.ok_or_else(|| wrong(format!("no port of domain {domain} is free")))?;
        from.set_read_timeout(Some(REPEAT))?;
        let numbers = (0..PARTICIPANTS).filter_map(|number| port(domain, number));
        let peers = numbers.flat_map(|port| addresses.iter().map(move |a| SocketAddr::new(a.ip(), port)));
        Ok(Self { from, to: UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?, prefix, peers: peers.collect() })
    }

    /// Passes on from now on; ends with the program.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn start(self) -> std::io::Result<()> {
        std::thread::Builder::new().name("cairn-ros-peers".into()).spawn(move || self.run()).map(drop)
    }

    fn run(&self) {
        let (mut message, mut last) = ([0; 65536], Vec::new());
        loop {
            // An error is that nothing came for a while, or that of an earlier message which nobody took.
            if let Ok((length, _)) = self.from.recv_from(&mut message) {
                if !is_of(&message[..length], &self.prefix) {
                    continue;
                }
                last = message[..length].to_vec();
            }
            for peer in self.peers.iter().filter(|_| !last.is_empty()) {
                // A port on which nobody waits refuses; the next announcement tries again.
                let _ = self.to.send_to(&last, peer);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_announcements_reach_a_peer_and_those_of_others_do_not() {
        const DOMAIN: u16 = 201;
        // The peer is another address of this machine.
        let peer = UdpSocket::bind(("127.0.0.3", port(DOMAIN, 5).unwrap())).unwrap();
        peer.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let own: Vec<u8> = (1..=12).collect();
        Announcer::new(DOMAIN, own.clone(), &["127.0.0.3".into()]).unwrap().start().unwrap();
        let message = |prefix: &[u8], tail: u8| [b"RTPS\x02\x05\x01\x12", prefix, &[tail; 40]].concat();
        let library = UdpSocket::bind("127.0.0.1:0").unwrap();
        let announce = |message: &[u8]| {
            for number in ANNOUNCED {
                let _ = library.send_to(message, ("127.0.0.1", port(DOMAIN, number).unwrap()));
            }
        };
        announce(&message(&[9; 12], 1));
        announce(b"RTPS");
        announce(&message(&own, 2));
        let mut got = [0; 100];
        let (length, _) = peer.recv_from(&mut got).expect("an announcement");
        assert_eq!(&got[..length], message(&own, 2), "as it was sent, and no other before it");
        let (length, _) = peer.recv_from(&mut got).expect("the same again, for who came late");
        assert_eq!(&got[..length], message(&own, 2));
    }

    #[test]
    fn a_peer_that_is_none_is_refused() {
        let refused =
            |domain, peer: &str| Announcer::new(domain, vec![0; 12], &[peer.to_owned()]).unwrap_err();
        assert!(refused(0, "256.1.1.1").to_string().contains("256.1.1.1"));
        assert!(refused(u16::MAX, "127.0.0.1").to_string().contains("domain"));
    }
}
