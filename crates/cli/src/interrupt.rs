//! Signals end any command, whatever it waits for.
//!
//! TERM, Ctrl-C and a hang-up set one flag, which ends waiting for a stream, a disk or the next packet. A command that
//! has something to write says so ([`in_order`]) and ends by itself, with all its outputs. Any other is given a moment to
//! clean up, and then ended with a message. A second TERM or Ctrl-C stops at once; a second hang-up does not, because a
//! closing terminal may send several. The exit code is 130 in all cases.

use crate::output::{INTERRUPTED, NOTHING, note};
use cairn_sources::Cancel;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// How long a command without results may take to clean up.
const GRACE: Duration = Duration::from_millis(400);

type Action = Box<dyn FnMut() + Send>;

struct State {
    cancel: Cancel,
    /// Whether the command ends by itself.
    in_order: AtomicBool,
    /// Done at the first signal.
    at_request: Mutex<Vec<Action>>,
    /// Done before the process is ended from here.
    before_exit: Mutex<Vec<Action>>,
}

fn state() -> &'static State {
    static STATE: OnceLock<State> = OnceLock::new();
    STATE.get_or_init(|| State {
        cancel: Cancel::default(),
        in_order: AtomicBool::new(false),
        at_request: Mutex::default(),
        before_exit: Mutex::default(),
    })
}

/// Takes the signals from now on. Where that is impossible they end the program as usual.
pub fn listen() {
    let mut signals = vec![SIGINT, SIGTERM];
    #[cfg(unix)]
    if !hang_up_is_ignored() {
        signals.push(signal_hook::consts::SIGHUP);
    }
    let Ok(mut signals) = Signals::new(signals) else { return };
    // If the thread cannot be started, the signals are lost; then there is nothing left that could run anyway.
    let _ = std::thread::Builder::new().name("cairn-signals".into()).spawn(move || {
        let mut first = true;
        for signal in signals.forever() {
            let again = !std::mem::replace(&mut first, false);
            match again {
                false => on_first(),
                true if signal == SIGINT || signal == SIGTERM => exit(),
                true => {}
            }
        }
    });
}

fn on_first() {
    let state = state();
    state.cancel.cancel();
    run_all(&state.at_request);
    // Another thread, so that a second signal is heard.
    let _ = std::thread::Builder::new().name("cairn-grace".into()).spawn(|| {
        let began = Instant::now();
        while !is_in_order() {
            if began.elapsed() > GRACE {
                note(NOTHING);
                exit();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    });
}

fn exit() -> ! {
    run_all(&state().before_exit);
    std::process::exit(i32::from(INTERRUPTED))
}

fn run_all(actions: &Mutex<Vec<Action>>) {
    actions.lock().unwrap_or_else(PoisonError::into_inner).iter_mut().for_each(|action| action());
}

/// True once the user asked for an end.
pub fn requested() -> bool {
    state().cancel.is_cancelled()
}

/// The flag that ends waiting, for sources.
pub fn cancel() -> Cancel {
    state().cancel.clone()
}

/// Sets this flag too when the user asks for an end.
pub fn sets(flag: Arc<AtomicBool>) {
    at_request(move || flag.store(true, Ordering::Relaxed));
}

/// Does this when the user asks for an end, at once if that has happened.
pub fn at_request(mut action: impl FnMut() + Send + 'static) {
    let mut actions = state().at_request.lock().unwrap_or_else(PoisonError::into_inner);
    match requested() {
        true => action(),
        false => actions.push(Box::new(action)),
    }
}

/// Does this if the process is ended by a signal without returning from its commands.
pub fn before_exit(action: impl FnMut() + Send + 'static) {
    state().before_exit.lock().unwrap_or_else(PoisonError::into_inner).push(Box::new(action));
}

/// From here on the command ends by itself after a signal, with its results written.
pub fn in_order() {
    state().in_order.store(true, Ordering::SeqCst);
}

/// Whether the command had begun to produce something that it writes after a signal.
pub fn is_in_order() -> bool {
    state().in_order.load(Ordering::SeqCst)
}

/// Whether the run was started to outlive its terminal, as by nohup. Known on Linux only.
#[cfg(unix)]
fn hang_up_is_ignored() -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return false };
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal_hook::consts::SIGHUP - 1) & 1 == 1
}
