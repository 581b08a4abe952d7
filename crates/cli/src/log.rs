//! Messages on stderr by `tracing`: warnings, unless `RUST_LOG` says otherwise (`RUST_LOG=cairn=debug`).
//!
//! A message is a line that begins with its level, as in `warning: ...`. Results never go this way.

use crate::style::{self, Paint};
use std::fmt;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// What is shown without `RUST_LOG`.
const USUAL: &str = "warn";

/// Starts logging; returns what is wrong with `RUST_LOG`, if anything.
pub fn start() -> Option<String> {
    let (filter, wrong) = match std::env::var("RUST_LOG") {
        Ok(text) if !text.trim().is_empty() => match EnvFilter::try_new(&text) {
            Ok(filter) => (filter, None),
            Err(e) => (
                EnvFilter::new(USUAL),
                Some(format!("RUST_LOG={text} is not understood ({e}): it is ignored")),
            ),
        },
        _ => (EnvFilter::new(USUAL), None),
    };
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .event_format(Lines)
        .finish();
    // Set once, at the start of the program.
    let _ = tracing::subscriber::set_global_default(subscriber);
    wrong
}

/// One line for each message.
struct Lines;

impl<S, N> FormatEvent<S, N> for Lines
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut to: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let (name, paint) = match *event.metadata().level() {
            Level::ERROR => ("error", Paint::Wrong),
            Level::WARN => ("warning", Paint::Doubtful),
            Level::INFO => ("info", Paint::Plain),
            Level::DEBUG => ("debug", Paint::Faint),
            Level::TRACE => ("trace", Paint::Faint),
        };
        write!(to, "{} ", style::on_stderr(paint, &format!("{name}:")))?;
        let mut line = String::new();
        context.field_format().format_fields(Writer::new(&mut line), event)?;
        to.write_str(line.trim_end())?;
        to.write_char('\n')
    }
}
