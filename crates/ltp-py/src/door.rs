//! The one door into the core: the interpreter is released, errors and panics are translated, Ctrl-C is heard.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use ltp_core::Result;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::error::{Failure, from_panic};

/// Time between two looks at the keyboard: short for a hand, long for a processor.
const LISTEN: Duration = Duration::from_millis(50);
/// Stack of a worker, bytes: what a main thread usually has.
const STACK: usize = 8 << 20;

/// Does short work (well below a second) on the calling thread, with the interpreter released.
pub fn short<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    settle(py.detach(|| catch_unwind(AssertUnwindSafe(work))))
}

/// Does long work on a thread of its own while the calling thread listens for Ctrl-C.
///
/// Python delivers signals on its main thread and only while that thread runs Python code, so the calling thread must not
/// be the one that computes. An interrupt returns at once; the flag that `work` was given is then set, and `work` is to
/// end soon after, its result unseen.
pub fn long<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(Arc<AtomicBool>) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    let (send, mut inbox) = mpsc::channel();
    let worker = thread::Builder::new().name("ltp".into()).stack_size(STACK).spawn(move || {
        // Nobody listens after an interrupt: the result is dropped here.
        let _ = send.send(catch_unwind(AssertUnwindSafe(|| work(flag))));
    });
    worker
        .map_err(|e| PyRuntimeError::new_err(format!("the system gave ltp no thread to work on ({e}); try again")))?;
    loop {
        let (back, news) = py.detach(move || {
            let news = inbox.recv_timeout(LISTEN);
            (inbox, news)
        });
        inbox = back;
        match news {
            Ok(outcome) => return settle(outcome),
            Err(RecvTimeoutError::Timeout) => {
                py.check_signals().inspect_err(|_| interrupted.store(true, Ordering::Relaxed))?;
            }
            Err(RecvTimeoutError::Disconnected) => return Err(from_panic(&"the worker vanished")),
        }
    }
}

/// What came of it, as Python is told.
fn settle<T>(outcome: thread::Result<Result<T>>) -> PyResult<T> {
    match outcome {
        Ok(result) => result.map_err(|error| Failure::from(error).into()),
        Err(panic) => Err(from_panic(&*panic)),
    }
}
