//! path recorder, clean-up, matcher, guide, phrases, announcement queue.
