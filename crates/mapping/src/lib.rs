//! from key frames to a refined map.
