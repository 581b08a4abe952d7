//! Keys: of the team, which seals every message, and of a robot, which signs what it publishes.
//!
//! Every message is `version` (1 byte), the first 16 bytes of its HMAC-SHA-256 (RFC 2104) under the team's key, and its
//! body. What a robot publishes is signed by Ed25519 (RFC 8032), because other robots pass it on.

use crate::{Refused, RobotId, VERSION};
use ring::signature::{Ed25519KeyPair, KeyPair};
use ring::{digest, hmac};

/// Bytes of the seal in front of every message.
const TAG: usize = 16;
const HEADER: usize = 1 + TAG;

/// The key that all robots of a team have; messages under another key are refused.
#[derive(Clone, Debug)]
pub struct TeamKey(hmac::Key);

impl TeamKey {
    /// The key of this secret. The bare name of a team keeps teams apart, but is no secret.
    pub fn new(secret: &[u8]) -> Self {
        Self(hmac::Key::new(hmac::HMAC_SHA256, secret))
    }

    pub(super) fn seal(&self, body: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER + body.len());
        bytes.push(VERSION);
        bytes.extend(&hmac::sign(&self.0, body).as_ref()[..TAG]);
        bytes.extend(body);
        bytes
    }

    pub(super) fn open<'a>(&self, bytes: &'a [u8]) -> Result<&'a [u8], Refused> {
        let short = || Refused::TooShort(bytes.len());
        let (version, rest) = bytes.split_first().ok_or_else(short)?;
        if *version != VERSION {
            return Err(Refused::Version(*version));
        }
        let (tag, body) = rest.split_first_chunk::<TAG>().ok_or_else(short)?;
        let expected = hmac::sign(&self.0, body);
        // All bytes are compared, so that the time does not tell how many are right.
        let difference = tag.iter().zip(expected.as_ref()).fold(0, |sum, (a, b)| sum | (a ^ b));
        if difference == 0 { Ok(body) } else { Err(Refused::Seal) }
    }
}

/// Why an identity cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IdentityError {
    /// The system gives no random numbers.
    #[error("the system gives no random numbers")]
    Random,
    /// The seed gives no key.
    #[error("this seed gives no key")]
    Seed,
}

/// A robot's number with the key that proves it.
#[derive(Debug)]
pub struct Identity {
    robot: RobotId,
    pair: Ed25519KeyPair,
    public: [u8; 32],
}

impl Identity {
    /// The identity of this robot with the key of this seed, which must stay secret and the same as long as the robot
    /// keeps its number.
    ///
    /// # Errors
    /// [`IdentityError::Seed`] when the library refuses the seed.
    pub fn from_seed(robot: RobotId, seed: &[u8; 32]) -> Result<Self, IdentityError> {
        let pair = Ed25519KeyPair::from_seed_unchecked(seed).map_err(|_| IdentityError::Seed)?;
        let public = pair.public_key().as_ref().try_into().map_err(|_| IdentityError::Seed)?;
        Ok(Self { robot, pair, public })
    }

    /// A seed from the random numbers of the system.
    ///
    /// # Errors
    /// [`IdentityError::Random`] when there are none.
    pub fn new_seed() -> Result<[u8; 32], IdentityError> {
        let random = ring::rand::generate(&ring::rand::SystemRandom::new());
        random.map(ring::rand::Random::expose).map_err(|_| IdentityError::Random)
    }

    /// The robot's number.
    pub fn robot(&self) -> RobotId {
        self.robot
    }

    /// The public key.
    pub fn public(&self) -> [u8; 32] {
        self.public
    }

    pub(super) fn sign(&self, bytes: &[u8]) -> Vec<u8> {
        self.pair.sign(bytes).as_ref().to_vec()
    }
}

pub(super) fn is_signed(public: &[u8; 32], bytes: &[u8], signature: &[u8]) -> bool {
    let key = ring::signature::UnparsedPublicKey::new(&ring::signature::ED25519, public);
    key.verify(bytes, signature).is_ok()
}

/// The first bytes of the SHA-256 of some bytes.
pub(super) fn hash<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let digest = digest::digest(&digest::SHA256, bytes);
    std::array::from_fn(|k| digest.as_ref().get(k).copied().unwrap_or(0))
}
