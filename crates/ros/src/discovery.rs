//! How far the node looks for others: the environment variables of ROS 2 ("Improved Dynamic Discovery" of its documentation).

use std::net::Ipv4Addr;

/// Where others are looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Discovery {
    /// The only network that is used.
    pub only: Option<Ipv4Addr>,
    /// Machines that are told of this node one by one: names or addresses.
    pub peers: Vec<String>,
    /// What is asked for and not done, one line each.
    pub notes: Vec<String>,
}

impl Discovery {
    /// By `ROS_LOCALHOST_ONLY`, `ROS_AUTOMATIC_DISCOVERY_RANGE` and `ROS_STATIC_PEERS`.
    pub fn of_environment() -> Self {
        Self::of(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
    }

    fn of(variable: impl Fn(&str) -> Option<String>) -> Self {
        let mut found = Self::default();
        // As in Jazzy, the older variable decides where it is 1.
        let range = match variable("ROS_LOCALHOST_ONLY").as_deref() {
            Some("1") => Some("LOCALHOST".to_owned()),
            _ => variable("ROS_AUTOMATIC_DISCOVERY_RANGE"),
        };
        match range.as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => {}
            Some("LOCALHOST") => found.only = Some(Ipv4Addr::LOCALHOST),
            Some("OFF") => {
                found.only = Some(Ipv4Addr::LOCALHOST);
                found.notes.push(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: this node still finds those on this machine".into(),
                );
            }
            Some(other) => {
                let known = "SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT; the subnet is used";
                found.notes.push(format!("ROS_AUTOMATIC_DISCOVERY_RANGE is \"{other}\", and may be {known}"));
            }
        }
        if let (Some(peers), true) = (variable("ROS_STATIC_PEERS"), range.as_deref() != Some("OFF")) {
            found.peers = peers.split(';').map(|p| p.trim().to_owned()).filter(|p| !p.is_empty()).collect();
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_says_how_far_others_are_looked_for() {
        let of = |set: &[(&str, &str)]| {
            Discovery::of(|name| set.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
        };
        assert_eq!(of(&[]), Discovery::default());
        assert_eq!(
            of(&[("ROS_LOCALHOST_ONLY", "0"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]),
            Discovery::default()
        );
        let here = Some(Ipv4Addr::LOCALHOST);
        assert_eq!(
            of(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]),
            Discovery { only: here, ..Discovery::default() }
        );
        let older = of(&[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]);
        assert_eq!((older.only, older.notes.len()), (here, 0));
        let off = of(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"), ("ROS_STATIC_PEERS", "10.0.0.2")]);
        assert_eq!((off.only, off.notes.len(), off.peers.len()), (here, 1, 0));
        let peers = of(&[("ROS_STATIC_PEERS", "10.0.0.2; robot.local;")]).peers;
        assert_eq!(peers, ["10.0.0.2", "robot.local"]);
        let odd = of(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "far")]);
        assert!(odd.only.is_none() && odd.notes[0].contains("far"), "{odd:?}");
    }
}
