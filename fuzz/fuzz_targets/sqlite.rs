//! SQLite files of rosbag2: any bytes behind the first ones of the format; see `bag_reading.rs`.
#![no_main]

mod bag_reading;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| bag_reading::check(b"SQLite format 3\0", bytes));
