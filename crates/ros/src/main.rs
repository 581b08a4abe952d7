//! `cairn-ros`: Cairn as a node of ROS 2.

use cairn_ros::node;
use cairn_ros::options::Options;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn main() -> ExitCode {
    let options = match Options::parse_arguments(std::env::args()) {
        Ok(options) => options,
        Err(e) => e.exit(),
    };
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // A second signal ends the program at once.
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, stop.clone());
        let _ = signal_hook::flag::register(signal, stop.clone());
    }
    match node::run(&options, &stop) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("cairn-ros: error: {e}");
            ExitCode::FAILURE
        }
    }
}
