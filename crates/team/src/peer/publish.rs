//! What a robot publishes: the words of its key frames, features of some of them, and its map, each with a version that rises when it changes.

use super::Peer;
use super::message::{
    BLOCK_BYTES, Layer, MAX_BLOCKS, MAX_PART_BYTES, MAX_PLACES_PART_BYTES, MAX_WORDS_PART_BYTES, Manifest,
};
use super::part::Part;
use crate::{PlaceRequests, Refused};

impl Peer {
    /// Publishes this robot's map in place of the one before, and returns its version: the same one if it has not
    /// changed.
    ///
    /// # Errors
    /// When it is empty or too long ([`MAX_PART_BYTES`]).
    pub fn publish(&mut self, bytes: &[u8]) -> Result<u32, Refused> {
        self.publish_pieces(bytes, &[bytes.len()])
    }

    /// As [`Peer::publish`], for bytes made of pieces of these lengths, of which later versions have many in common: a
    /// piece that others already have is not sent again.
    ///
    /// # Errors
    /// As [`Peer::publish`], and when the pieces do not make up the bytes or are too many.
    pub fn publish_pieces(&mut self, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        if bytes.is_empty() || bytes.len() > MAX_PART_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        self.publish_layer(Layer::Map, bytes, lengths)
    }

    /// As [`Peer::publish_pieces`], for the words of this robot's key frames, to be published before its map.
    ///
    /// # Errors
    /// As [`Peer::publish_pieces`], with [`MAX_WORDS_PART_BYTES`].
    pub fn publish_words(&mut self, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        if bytes.is_empty() || bytes.len() > MAX_WORDS_PART_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        self.publish_layer(Layer::Words, bytes, lengths)
    }

    /// As [`Peer::publish_pieces`], for the features of key frames that, by their words, show what robots of greater numbers saw.
    ///
    /// # Errors
    /// As [`Peer::publish_pieces`], with [`MAX_PLACES_PART_BYTES`].
    pub fn publish_places(&mut self, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        if bytes.is_empty() || bytes.len() > MAX_PLACES_PART_BYTES {
            return Err(Refused::TooLong(bytes.len()));
        }
        self.publish_layer(Layer::Places, bytes, lengths)
    }

    /// Publishes which key frames of robots of smaller numbers this one needs features of, in place of what it asked for before.
    ///
    /// # Errors
    /// When more is asked for than a robot may ([`crate::MAX_REQUESTED`] of one robot).
    pub fn publish_requests(&mut self, requests: &PlaceRequests) -> Result<u32, Refused> {
        let too_much = Refused::Inconsistent("it asks for more key frames than a robot may");
        let bytes = requests.encode(self.robot()).ok_or(too_much)?;
        self.publish_layer(Layer::Requests, &bytes, &[bytes.len()])
    }

    fn publish_layer(&mut self, layer: Layer, bytes: &[u8], lengths: &[usize]) -> Result<u32, Refused> {
        let mut blocks: Vec<&[u8]> = Vec::new();
        let mut rest = bytes;
        for length in lengths {
            let (piece, after) = rest
                .split_at_checked(*length)
                .ok_or(Refused::Inconsistent("its pieces are longer than it"))?;
            blocks.extend(piece.chunks(BLOCK_BYTES));
            rest = after;
        }
        if !rest.is_empty() || blocks.len() > MAX_BLOCKS {
            return Err(Refused::Inconsistent("its pieces do not make it up, or are too many"));
        }
        let topic = (self.robot(), layer);
        let version = |part: Option<&Part>| part.map_or(0, |part| part.manifest.version);
        let newest = version(self.parts.get(&topic)).max(version(self.coming.get(&topic)));
        let same = self.parts.get(&topic).filter(|part| {
            let m = Manifest::new(&self.identity, layer, part.manifest.version, &blocks);
            part.manifest.version == newest && m.stamp() == part.stamp
        });
        if same.is_some() {
            return Ok(newest);
        }
        Ok(self.publish_as(layer, newest.saturating_add(1), &blocks))
    }

    pub(super) fn publish_as(&mut self, layer: Layer, version: u32, blocks: &[&[u8]]) -> u32 {
        let part = Part::whole(Manifest::new(&self.identity, layer, version, blocks), blocks);
        let topic = (self.robot(), layer);
        self.coming.remove(&topic);
        self.parts.insert(topic, part);
        version
    }
}
