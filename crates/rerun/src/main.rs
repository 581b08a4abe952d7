//! `cairn-rerun OUT.rrd`: writes the messages on its standard input as a recording of the rerun viewer; `cairn-rerun
//! rerun+http://HOST:PORT/proxy` shows them in a viewer that runs there. `cairn run --rerun` starts it. When the input ends
//! early, the recording is closed with what there is, and the exit status is 1.

mod error;
mod recording;

use cairn_rerun::{Message, read};
use error::RecordError;
use recording::Recording;
use std::io::{BufReader, stdin};
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (first, more) = (arguments.next(), arguments.next());
    match first {
        Some(flag) if flag == "--version" => {
            println!("cairn-rerun {}", env!("CARGO_PKG_VERSION"));
            ExitCode::SUCCESS
        }
        Some(path) if more.is_none() => match record(Path::new(&path)) {
            Ok(()) => ExitCode::SUCCESS,
            Err(why) => {
                eprintln!("{why}");
                ExitCode::FAILURE
            }
        },
        _ => {
            eprintln!(
                "usage: cairn-rerun OUT.rrd, or rerun+http://HOST:PORT/proxy for a viewer that runs there, with messages on \
                 standard input; cairn run --rerun starts it"
            );
            ExitCode::from(2)
        }
    }
}

/// Writes all messages; the recording is closed also after a failure.
fn record(path: &Path) -> Result<(), RecordError> {
    let mut messages = read(BufReader::new(stdin().lock()))?;
    let Some(Ok(Message::Begin { name })) = messages.next() else {
        return Err(RecordError::NoBeginning);
    };
    let to = Recording::begin(path, &name)?;
    let written = (|| {
        for message in messages {
            match message? {
                Message::Begin { .. } => return Err(RecordError::BeginsTwice),
                Message::At { stamp_ns, frame } => to.at(stamp_ns, frame),
                Message::Show { entity, what } => to.show(&entity, &what)?,
                Message::End => return Ok(()),
            }
        }
        Err(RecordError::EndsEarly)
    })();
    let ended = to.end();
    written.and(ended)
}
