//! A name of this machine in the local network that stays when its address changes, where the system announces one (Bonjour,
//! Avahi, Windows). It is found as a phone finds it: by a one-shot query of multicast DNS (RFC 6762, sections 5.1 and 6.7),
//! so that a name is given out only where somebody answers for it with this machine's address.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Where multicast DNS is asked.
const GROUP: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(224, 0, 0, 251)), 5353);
/// Responders answer for their own names within milliseconds.
const WITHIN: Duration = Duration::from_millis(700);
/// The head of a message, and of what follows the name of a question and of a record (RFC 1035, section 4.1).
const HEAD: usize = 12;
const QUESTION: usize = 4;
const RECORD: usize = 10;
/// An IPv4 address, in the internet.
const A_IN: [u8; 4] = [0, 1, 0, 1];

/// The machine's name with `.local`, if it leads to this address of its own.
pub(crate) fn local_name(address: IpAddr) -> Option<String> {
    let host = host()?;
    leads_to(&host, address, GROUP).then(|| format!("{host}.local"))
}

/// What the machine is called: a single label.
fn host() -> Option<String> {
    let kept = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let asked = || String::from_utf8(std::process::Command::new("hostname").output().ok()?.stdout).ok();
    let name = kept.or_else(asked)?.trim().split('.').next()?.to_lowercase();
    let is_label = |name: &str| {
        (1..=63).contains(&name.len()) && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')
    };
    is_label(&name).then_some(name)
}

/// Whether an answer to the question for the name has the address.
fn leads_to(host: &str, address: IpAddr, to: SocketAddr) -> bool {
    let IpAddr::V4(wanted) = address else { return false };
    let ask = || -> std::io::Result<bool> {
        let socket = UdpSocket::bind((address, 0))?;
        socket.send_to(&question(host), to)?;
        let (until, mut bytes) = (Instant::now() + WITHIN, [0; 1500]);
        while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
            socket.set_read_timeout(Some(left))?;
            let (length, _) = socket.recv_from(&mut bytes)?;
            if addresses(&bytes[..length]).is_some_and(|found| found.contains(&wanted)) {
                return Ok(true);
            }
        }
        Ok(false)
    };
    // Nobody answers, or there is no network.
    ask().unwrap_or(false)
}

fn question(host: &str) -> Vec<u8> {
    let mut message = vec![0; HEAD];
    message[5] = 1;
    for label in [host, "local"] {
        message.push(label.len() as u8);
        message.extend(label.bytes());
    }
    message.push(0);
    message.extend(A_IN);
    message
}

/// The addresses in an answer; nothing for a message that is none or is cut off.
fn addresses(message: &[u8]) -> Option<Vec<Ipv4Addr>> {
    let count = |at: usize| Some(usize::from(u16::from_be_bytes(message.get(at..at + 2)?.try_into().ok()?)));
    if message.get(2)? & 0x80 == 0 {
        return None;
    }
    let mut at = HEAD;
    for _ in 0..count(4)? {
        at = behind_name(message, at)? + QUESTION;
    }
    let mut found = Vec::new();
    for _ in 0..count(6)? {
        at = behind_name(message, at)?;
        let head = message.get(at..at + RECORD)?;
        let length = count(at + 8)?;
        at += RECORD;
        let data = message.get(at..at + length)?;
        // The top bit of the class says that the answer replaces older ones.
        if [head[0], head[1], head[2] & 0x7f, head[3]] == A_IN {
            found.push(Ipv4Addr::from(<[u8; 4]>::try_from(data).ok()?));
        }
        at += length;
    }
    Some(found)
}

/// Where a name that begins here ends: with an empty label, or with the place of its rest.
fn behind_name(message: &[u8], mut at: usize) -> Option<usize> {
    loop {
        match usize::from(*message.get(at)?) {
            0 => return Some(at + 1),
            length if length >= 0xc0 => return Some(at + 2),
            length => at += 1 + length,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer of a responder for one address, as Avahi sends it: the question again, then the record.
    fn answer(question: &[u8], address: [u8; 4]) -> Vec<u8> {
        let mut message = question.to_vec();
        message[2] = 0x84;
        message[7] = 1;
        message.extend([0xc0, HEAD as u8, 0, 1, 0x80, 1, 0, 0, 0, 10, 0, 4]);
        message.extend(address);
        message
    }

    #[test]
    fn a_name_counts_where_somebody_answers_with_this_address() {
        let responder = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (to, own) = (responder.local_addr().unwrap(), IpAddr::from([127, 0, 0, 1]));
        let serve = std::thread::spawn(move || {
            for address in [[127, 0, 0, 1], [192, 168, 1, 9]] {
                let mut bytes = [0; 512];
                let (length, from) = responder.recv_from(&mut bytes).unwrap();
                assert_eq!(bytes[..length], question("den"), "{:?}", &bytes[..length]);
                // What is no answer, or damaged, is passed over.
                let whole = answer(&bytes[..length], address);
                for part in [&bytes[..length], &whole[..whole.len() - 1], &[], &[0xff; 40], &whole] {
                    responder.send_to(part, from).unwrap();
                }
            }
        });
        assert!(leads_to("den", own, to));
        assert!(!leads_to("den", own, to), "it is another machine's");
        serve.join().unwrap();
    }

    #[test]
    fn no_cut_message_is_read_beyond_its_end() {
        let whole = answer(&question("den"), [10, 0, 0, 1]);
        assert_eq!(addresses(&whole), Some(vec![Ipv4Addr::new(10, 0, 0, 1)]));
        assert!((0..whole.len()).all(|n| addresses(&whole[..n]).is_none_or(|found| found.is_empty())));
    }
}
