//! A progress bar, shown only on a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar on stderr; hidden when stderr is not a terminal, cleared when dropped.
pub struct Progress(ProgressBar);

impl Progress {
    /// With the total number of steps, if it is known.
    pub fn new(steps: Option<usize>) -> Self {
        let progress = Self(ProgressBar::no_length());
        progress.begin(steps);
        progress
    }

    /// Begins again with the total number of steps, if it is known.
    pub fn begin(&self, steps: Option<usize>) {
        steps.iter().for_each(|n| self.0.set_length(*n as u64));
        let shown = if steps.is_some() { "{wide_bar} {pos}/{len}, {eta} left" } else { "{spinner} {pos}" };
        if let Ok(style) = ProgressStyle::with_template(shown) {
            self.0.set_style(style);
        }
    }

    /// Takes it off the terminal.
    pub fn clear(&self) {
        self.0.finish_and_clear();
    }

    /// A bar that is never drawn; warnings are still printed.
    pub fn hidden() -> Self {
        Self(ProgressBar::hidden())
    }

    /// Sets the number of finished steps.
    pub fn step(&self, done: usize) {
        self.0.set_position(done as u64);
    }

    /// Prints a warning on stderr without breaking the bar.
    pub fn warn(&self, text: &str) {
        self.0.suspend(|| crate::output::warn(text));
    }

    /// Prints a line on stderr without breaking the bar.
    pub fn note(&self, text: &str) {
        self.0.suspend(|| crate::output::note(text));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}
