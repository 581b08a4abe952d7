//! Members on the loopback: real links, garbage on the port, and one that goes away and comes back.

use cairn_team::peer::{Identity, Peer, TeamKey};
use cairn_wire::Member;
use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

fn member(robot: u16, dial: &[String]) -> Member {
    let identity = Identity::from_seed(robot, &[robot as u8; 32]).unwrap();
    Member::open(Peer::new(identity, TeamKey::new(b"key")), "127.0.0.1:0", dial).unwrap()
}

/// Steps all until they have as many parts and the same, and returns what was said.
fn settle(members: &mut [&mut Member], parts: usize) -> Vec<String> {
    let until = Instant::now() + Duration::from_secs(20);
    let mut lines = Vec::new();
    loop {
        let first = members[0].peer().digest();
        if members.iter().all(|m| m.peer().holdings().count() == parts && m.peer().digest() == first) {
            return lines;
        }
        assert!(Instant::now() < until, "not the same after 20 s: {lines:?}");
        for member in members.iter_mut() {
            lines.extend(member.step(Duration::from_millis(10)));
        }
    }
}

#[test]
fn three_share_over_one_that_knows_both_and_one_comes_back() {
    let mut a = member(1, &[]);
    let hub = a.address().to_string();
    let (mut b, mut c) = (member(2, std::slice::from_ref(&hub)), member(3, std::slice::from_ref(&hub)));
    let map = |k: u8| (0..300_000u32).map(|n| (n / 3) as u8 ^ k).collect::<Vec<u8>>();
    for (m, k) in [(&mut a, 1), (&mut b, 2), (&mut c, 3)] {
        m.peer_mut().publish(&map(k)).unwrap();
    }
    assert!(settle(&mut [&mut a, &mut b, &mut c], 3).is_empty());
    // Robot 2 is gone; robot 3 goes on; robot 2 comes back with nothing but its key and gets all, its own map too.
    drop(b);
    c.peer_mut().publish(&map(9)).unwrap();
    settle(&mut [&mut a, &mut c], 3);
    let mut b = member(2, &[hub]);
    settle(&mut [&mut a, &mut b, &mut c], 3);
    assert!(b.peer().parts().any(|(holding, bytes)| holding.robot == 2 && bytes == map(2)));
    assert_eq!(a.refused() + b.refused() + c.refused(), 0);
}

#[test]
fn a_map_takes_the_time_that_the_limit_gives_it() {
    let mut a = member(1, &[]).with_send_limit(200_000.0);
    let mut b = member(2, &[a.address().to_string()]);
    a.peer_mut()
        .publish(&(0..600_000u32).map(|n| (n / 3) as u8 ^ (n / 65_536) as u8).collect::<Vec<u8>>())
        .unwrap();
    let began = Instant::now();
    settle(&mut [&mut a, &mut b], 1);
    // What a second gives goes at once, and one block may be ahead.
    let seconds = began.elapsed().as_secs_f64();
    assert!((1.6..15.0).contains(&seconds), "600 kB at 200 kB/s took {seconds} s");
    let sent: u64 = a.peer().traffic().sent.values().map(|amount| amount.bytes).sum();
    assert!((600_000..620_000).contains(&sent), "{sent} bytes");
}

#[test]
fn garbage_on_the_port_is_one_line_and_the_team_goes_on() {
    let mut a = member(1, &[]);
    let hub = a.address();
    let mut noise = TcpStream::connect(hub).unwrap();
    for _ in 0..50 {
        noise.write_all(&[5, 0, 0, 0]).unwrap();
        noise.write_all(b"hello").unwrap();
    }
    let mut long = TcpStream::connect(hub).unwrap();
    long.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    let mut b = member(2, &[hub.to_string()]);
    b.peer_mut().publish(&[7; 100_000]).unwrap();
    let mut lines = settle(&mut [&mut a, &mut b], 1);
    let until = Instant::now() + Duration::from_secs(10);
    while (a.refused() < 50 || lines.len() < 3) && Instant::now() < until {
        lines.extend(a.step(Duration::from_millis(10)));
    }
    assert_eq!(a.refused(), 50);
    assert_eq!(lines.len(), 3, "{lines:?}");
    assert!(lines.iter().any(|l| l.contains("it announces a message of")), "{lines:?}");
}

#[test]
fn one_host_that_takes_every_place_keeps_no_robot_out() {
    let mut a = member(1, &[]);
    let hold = |count: usize| -> Vec<TcpStream> {
        (0..count).map(|_| TcpStream::connect(a.address()).unwrap()).collect()
    };
    // As many as there are places, and none says a word.
    let mut held = hold(64);
    let mut b = member(2, &[a.address().to_string()]);
    let later = hold(8);
    a.peer_mut().publish(&[1; 3000]).unwrap();
    b.peer_mut().publish(&[2; 3000]).unwrap();
    let began = Instant::now();
    settle(&mut [&mut a, &mut b], 2);
    println!("shared beside 72 silent connections after {:.2} s", began.elapsed().as_secs_f64());
    // The oldest had to make room: at its end nothing more comes.
    let first = &mut held[0];
    first.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    std::io::Read::read_to_end(first, &mut Vec::new()).expect("it was closed");
    // The robot keeps its place whoever comes later.
    let more: Vec<TcpStream> = (0..80).map(|_| TcpStream::connect(a.address()).unwrap()).collect();
    b.peer_mut().publish(&[3; 3000]).unwrap();
    let lines = settle(&mut [&mut a, &mut b], 2);
    assert!(lines.iter().all(|line| !line.contains("robot")), "{lines:?}");
    drop((held, later, more));
}
