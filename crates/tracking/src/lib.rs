//! from a frame and a map to a pose with evidence.
