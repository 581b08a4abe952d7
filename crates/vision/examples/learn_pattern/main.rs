//! Learns the descriptor's binary tests and prints the source file `src/orb/pattern.rs`:
//! `cargo run --release -p cairn-vision --example learn_pattern > crates/vision/src/orb/pattern.rs`.

mod learn;
mod patches;
mod scene;

fn main() {
    print!("{}", learn::regenerate());
}
