//! Keys: of the team, which encrypts every message, and of a robot, which signs what it publishes.
//!
//! Every message is `version` (1 byte), a nonce (24), and its body under ChaCha20-Poly1305 (RFC 8439) with the tag (16).
//! The nonce is an HMAC-SHA-256 (RFC 2104) of the body, and the key of the message an HMAC of the nonce, both under the
//! team's key. So no chance is needed, and only equal bodies have equal nonces (the synthetic initialisation vector of
//! Rogaway and Shrimpton, "A provable-security treatment of the key-wrap problem", 2006): who has not the key sees
//! lengths, times, and which messages are repetitions. What a robot publishes is signed by Ed25519 (RFC 8032), because
//! other robots pass it on.

use crate::{Refused, RobotId, VERSION};
use ring::signature::{Ed25519KeyPair, KeyPair};
use ring::{aead, digest, hmac};

const NONCE: usize = 24;
const TAG: usize = 16;
const HEADER: usize = 1 + NONCE;

/// The key that all robots of a team have; messages under another key are refused, and cannot be read.
#[derive(Clone, Debug)]
pub struct TeamKey(hmac::Key);

impl TeamKey {
    /// The key of this secret. The bare name of a team keeps teams apart, but is no secret.
    pub fn new(secret: &[u8]) -> Self {
        Self(hmac::Key::new(hmac::HMAC_SHA256, secret))
    }

    pub(super) fn seal(&self, body: &[u8]) -> Vec<u8> {
        let nonce = self.derive(b"nonce", body);
        let Some(nonce) = nonce.as_ref().first_chunk::<NONCE>() else { return Vec::new() };
        let mut bytes = Vec::with_capacity(HEADER + body.len() + TAG);
        bytes.push(VERSION);
        bytes.extend(nonce);
        bytes.extend(body);
        let sealed = self.message_key(nonce).and_then(|key| {
            key.seal_in_place_separate_tag(no_nonce(), aead::Aad::from([VERSION]), &mut bytes[HEADER..])
        });
        // Only a body of gigabytes cannot be encrypted; an empty message is refused by everyone.
        let Ok(tag) = sealed else { return Vec::new() };
        bytes.extend(tag.as_ref());
        bytes
    }

    pub(super) fn open(&self, bytes: &[u8]) -> Result<Vec<u8>, Refused> {
        let short = || Refused::TooShort(bytes.len());
        let (version, rest) = bytes.split_first().ok_or_else(short)?;
        if *version != VERSION {
            return Err(Refused::Version(*version));
        }
        let (nonce, rest) = rest.split_first_chunk::<NONCE>().ok_or_else(short)?;
        if rest.len() < TAG {
            return Err(short());
        }
        let key = self.message_key(nonce).map_err(|_| Refused::Seal)?;
        let mut body = rest.to_vec();
        let opened = key.open_in_place(no_nonce(), aead::Aad::from([VERSION]), &mut body);
        let length = opened.map_err(|_| Refused::Seal)?.len();
        body.truncate(length);
        Ok(body)
    }

    /// The key that only messages with this nonce have.
    fn message_key(&self, nonce: &[u8; NONCE]) -> Result<aead::LessSafeKey, ring::error::Unspecified> {
        let key = self.derive(b"message", nonce);
        Ok(aead::LessSafeKey::new(aead::UnboundKey::new(&aead::CHACHA20_POLY1305, key.as_ref())?))
    }

    fn derive(&self, what: &[u8], from: &[u8]) -> hmac::Tag {
        let mut context = hmac::Context::with_key(&self.0);
        context.update(what);
        context.update(from);
        context.sign()
    }
}

/// The cipher's own nonce: a message has a key of its own.
fn no_nonce() -> aead::Nonce {
    aead::Nonce::assume_unique_for_key([0; aead::NONCE_LEN])
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_team_reads_a_message_and_any_changed_byte_is_noticed() {
        let (team, other) = (TeamKey::new(b"a secret"), TeamKey::new(b"another one"));
        let body = b"the words of a key frame, the words of a key frame";
        let sealed = team.seal(body);
        assert_eq!(sealed.len(), HEADER + body.len() + TAG);
        assert_eq!(team.open(&sealed).unwrap(), body);
        assert_eq!(other.open(&sealed).unwrap_err(), Refused::Seal);
        // Nothing of the body is on the wire, and no two messages share a key stream.
        assert!(!sealed.windows(8).any(|w| body.windows(8).any(|of_body| of_body == w)));
        let mut changed = *body;
        changed[0] ^= 1;
        let next = team.seal(&changed);
        let equal = sealed[HEADER..].iter().zip(&next[HEADER..]).filter(|(a, b)| a == b).count();
        assert!(equal < 8, "{equal} of {} bytes are equal", sealed.len() - HEADER);
        for k in 0..sealed.len() {
            let mut changed = sealed.clone();
            changed[k] ^= 1;
            let expected = if k == 0 { Refused::Version(VERSION ^ 1) } else { Refused::Seal };
            assert_eq!(team.open(&changed).unwrap_err(), expected, "byte {k}");
            let cut = team.open(&sealed[..k]).unwrap_err();
            let expected = if k < HEADER + TAG { Refused::TooShort(k) } else { Refused::Seal };
            assert_eq!(cut, expected, "{k} bytes");
        }
    }
}
