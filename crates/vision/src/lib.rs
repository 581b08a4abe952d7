//! pyramid, FAST, ORB, matching, stereo, two-view geometry, PnP, triangulation.
