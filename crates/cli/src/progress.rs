//! A progress bar on a terminal, and nothing elsewhere.

use indicatif::{ProgressBar, ProgressStyle};

/// How far the work is; drawn on stderr, hidden where that is no terminal, gone when dropped.
pub struct Progress(ProgressBar);

impl Progress {
    /// Of so many steps, where that is known.
    pub fn new(steps: Option<usize>) -> Self {
        let bar = match steps {
            Some(n) => ProgressBar::new(n as u64),
            None => ProgressBar::no_length(),
        };
        let shown = if steps.is_some() { "{wide_bar} {pos}/{len}, {eta} left" } else { "{spinner} {pos}" };
        if let Ok(style) = ProgressStyle::with_template(shown) {
            bar.set_style(style);
        }
        Self(bar)
    }

    /// Never drawn; warnings are still told.
    pub fn hidden() -> Self {
        Self(ProgressBar::hidden())
    }

    /// So many are done.
    pub fn step(&self, done: usize) {
        self.0.set_position(done as u64);
    }

    /// A line on stderr that does not tear the bar.
    pub fn warn(&self, text: &str) {
        self.0.suspend(|| eprintln!("warning: {text}"));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
