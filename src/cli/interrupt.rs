//! Ctrl-C and SIGTERM: work that leaves a checkpoint is asked to stop through its
//! [`Progress`](crate::progress::Progress), which [`Ui`](super::Ui) implements; anything else stops at once.

use super::ExitStatus;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::{Read, Write};
use std::sync::atomic::{AtomicU8, Ordering::SeqCst};
use std::time::Duration;

/// The running work leaves no checkpoint: the process ends at once.
const AT_ONCE: u8 = 0;
/// The running work leaves a checkpoint when it is asked to stop.
const RESUMABLE: u8 = 1;
/// It has been asked to stop.
const REQUESTED: u8 = 2;

/// Shared by the thread that receives signals and the work; a process has one set of signal handlers.
static STATE: AtomicU8 = AtomicU8::new(AT_ONCE);

/// Takes Ctrl-C and SIGTERM, which batch systems and containers send first, over for the process.
pub(super) fn install() {
    // Without a handler or a thread the signals end the process, as they do by default.
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return };
    let _ = std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || signals.forever().for_each(on_signal));
}

fn on_signal(_: i32) {
    if STATE.compare_exchange(RESUMABLE, REQUESTED, SeqCst, SeqCst).is_ok() {
        let _ =
            writeln!(std::io::stderr(), "\ninterrupted: keeping what is done (Ctrl-C again stops at once)");
    } else {
        let _ = writeln!(std::io::stderr(), "\ninterrupted");
        std::process::exit(ExitStatus::Interrupted as i32);
    }
}

/// How long work that writes a checkpoint may continue after the program that started it has ended.
const GRACE: Duration = Duration::from_secs(30);

/// Stops the process as a signal does when standard input is closed, which happens when the program that holds its other
/// end exits, however it does.
pub(super) fn stop_with_parent() {
    let wait = || {
        let mut rest = [0; 256];
        let mut input = std::io::stdin().lock();
        while !matches!(input.read(&mut rest), Ok(0) | Err(_)) {}
        // The end may follow a signal, which asked for a checkpoint already.
        if !is_requested() {
            on_signal(0);
        }
        std::thread::sleep(GRACE);
        std::process::exit(ExitStatus::Interrupted as i32);
    };
    let _ = std::thread::Builder::new().name("parent".into()).spawn(wait);
}

/// Says whether the running work leaves a checkpoint when it is asked to stop: then a first signal only asks.
pub(super) fn set_resumable(is_resumable: bool) {
    let state = if is_resumable { RESUMABLE } else { AT_ONCE };
    // A request that came in the last moment is not forgotten: the next work that asks stops.
    let _ = STATE.fetch_update(SeqCst, SeqCst, |before| (before != REQUESTED).then_some(state));
}

/// Whether the running work should stop.
pub(super) fn is_requested() -> bool {
    STATE.load(SeqCst) == REQUESTED
}
