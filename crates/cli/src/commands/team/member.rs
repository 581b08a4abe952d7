//! How a robot takes part in its team: addresses, the secret of the team, and the key of the robot.

use super::paths::beside;
use crate::failure::Failure;
use crate::number::number;
use crate::output::warn;
use cairn::team::RobotId;
use cairn::team::peer::{Identity, Peer, TeamKey};
use cairn_files::MIB;
use cairn_wire::Member;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// How the other robots are reached.
#[derive(clap::Args, Clone)]
pub struct Reach {
    /// A file with a secret that only the robots of the team have; without it anybody who knows the name of the team can
    /// take part, and read what is sent.
    #[arg(help_heading = "Team", long, value_name = "FILE")]
    pub secret: Option<PathBuf>,
    /// The address at which other robots reach this one [default: 0.0.0.0:7450].
    #[arg(help_heading = "Team", long, value_name = "HOST:PORT")]
    pub listen: Option<String>,
    /// The address of another robot; may be repeated. One that is away is tried again twice a second.
    #[arg(help_heading = "Team", long, value_name = "HOST:PORT")]
    pub peer: Vec<String>,
    /// At most so many kB are sent in a second, in the mean and to all robots together: maps wait for their turn [default: 100].
    #[arg(help_heading = "Team", long, value_name = "KB", value_parser = number(1.0..=1e9, "a number of kilobytes from 1"))]
    pub send_limit: Option<f64>,
}

/// What a robot may send in a second: three that share a way stay below it (docs/figures/team.md).
const SEND_LIMIT_KB: f64 = 100.0;

impl Reach {
    /// Puts a peer on the network.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn member(&self, peer: Peer) -> Result<Member, Failure> {
        let listen = self.listen.as_deref().unwrap_or("0.0.0.0:7450");
        let member = Member::open(peer, listen, &self.peer).map_err(|e| {
            Failure::new(format!("--listen {listen}"), e.to_string(), "choose another address or port")
        })?;
        open_to_all(self.secret.is_some(), member.address()).iter().for_each(|why| warn(why));
        Ok(member.with_send_limit(1e3 * self.send_limit.unwrap_or(SEND_LIMIT_KB)))
    }
}

/// What is said where anybody on the network can take part.
fn open_to_all(has_secret: bool, listening: SocketAddr) -> Option<String> {
    (!has_secret && !listening.ip().is_loopback()).then(|| {
        format!(
            "anybody who reaches {listening} and knows the team's name can take part and read all maps; give all \
             robots one --secret FILE, or --listen on 127.0.0.1 where all run here"
        )
    })
}

/// The identity of a robot: its key is in a file beside its map or graph, made the first time.
///
/// # Errors
/// When that file cannot be read or made.
pub fn identity(robot: RobotId, map: &Path) -> Result<Identity, Failure> {
    let path = beside(map, "robot-key");
    let shown = path.display().to_string();
    let fail = |why: String| {
        Failure::new(&shown, why, "give the file back that was there, or remove it and take a new --robot")
    };
    let seed = if path.exists() {
        let bytes = cairn_files::read(&path, 32).map_err(|e| fail(e.to_string()))?;
        <[u8; 32]>::try_from(bytes).map_err(|b| fail(format!("a key has 32 bytes, it has {}", b.len())))?
    } else {
        let seed = Identity::new_seed().map_err(|e| fail(e.to_string()))?;
        write_secret(&path, &seed).map_err(|e| Failure::new(&shown, e.to_string(), "check its folder"))?;
        seed
    };
    Identity::from_seed(robot, &seed).map_err(|e| fail(e.to_string()))
}

/// Writes a file that only its owner can read; never over one that exists.
fn write_secret(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut options = std::fs::File::options();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    std::io::Write::write_all(&mut options.open(path)?, bytes)
}

/// The key of a team, of its name and the secret in a file.
///
/// # Errors
/// When the file cannot be read, or is too short for a secret.
pub fn team_key(team: &str, secret_file: Option<&Path>) -> Result<TeamKey, Failure> {
    let mut secret = team.as_bytes().to_vec();
    if let Some(path) = secret_file {
        let fail = |why: String| {
            Failure::new(path.display().to_string(), why, "give a file with at least 16 bytes of secret")
        };
        let bytes = cairn_files::read(path, MIB).map_err(|e| fail(e.to_string()))?;
        if bytes.len() < 16 {
            return Err(fail(format!("it has {} bytes", bytes.len())));
        }
        secret.push(0);
        secret.extend(bytes);
    }
    Ok(TeamKey::new(&secret))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_team_without_a_secret_is_warned_unless_it_listens_on_this_machine_alone() {
        let address = |text: &str| text.parse::<SocketAddr>().unwrap();
        let warned = open_to_all(false, address("0.0.0.0:7450")).unwrap();
        assert!(warned.contains("0.0.0.0:7450") && warned.contains("--secret"), "{warned}");
        assert!(open_to_all(false, address("192.0.2.4:7450")).is_some());
        assert_eq!(open_to_all(true, address("0.0.0.0:7450")), None);
        assert_eq!(open_to_all(false, address("127.0.0.1:7450")), None);
    }
}
