//! The page in a real browser: headless Chromium, whose camera shows a simulated walk. Records, returns with the camera
//! facing back, reads the directions; axe-core reports nothing; screenshots are left in the target folder.
//!
//! Needs Chromium (`CHROMIUM`, else `chromium` on the path) and for the accessibility part axe-core (`AXE_JS`, its
//! `axe.min.js`); a missing part is reported as skipped. Run by `.ci/run` and by
//! `cargo test --release -p cairn-web --test suite browser:: -- --ignored --nocapture`.

mod alone;
mod cdp;
mod first;
mod pace;
mod parts;
mod routes;
mod seen;
mod session;
mod walk;
