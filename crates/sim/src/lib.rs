//! simulated worlds: renderer, walkers, exact truth, simulated IMU.
