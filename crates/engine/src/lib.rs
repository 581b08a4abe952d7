//! the stages wired: lockstep and threaded runners, config, report.
