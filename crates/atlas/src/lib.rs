//! key frames, landmarks, maps, change sets.
