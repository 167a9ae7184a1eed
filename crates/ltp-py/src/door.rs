//! The one door into the core: the interpreter is released, errors and panics are translated, Ctrl-C is heard.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
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

/// Says what is being done, and which fraction in [0, 1] of all is behind.
type Tell = dyn Fn(&str, f64) + Send + Sync;

/// What long work sees of the outside.
pub struct Outside {
    /// Set when the result is not wanted any more: the work is to end soon after.
    pub interrupted: Arc<AtomicBool>,
    /// Tells the caller how far the work is.
    pub tell: Box<Tell>,
}

/// What the calling thread hears from the one that works.
enum News<T> {
    Progress(String, f64),
    Done(thread::Result<Result<T>>),
}

/// Does long work on a thread of its own while the calling thread listens for Ctrl-C and passes progress on.
///
/// Python delivers signals on its main thread and only while that thread runs Python code, so the calling thread must not
/// be the one that computes. An interrupt, or an exception of `progress`, is raised at once; the work is told to end, and
/// its result is not waited for.
pub fn long<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(Outside) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let (send, inbox) = mpsc::channel();
    let messages = send.clone();
    // Nobody listens after an interrupt: what is sent then is dropped.
    let tell = move |doing: &str, done| drop(messages.send(News::Progress(doing.to_owned(), done)));
    let outside = Outside { interrupted: Arc::clone(&interrupted), tell: Box::new(tell) };
    let worker = thread::Builder::new().name("ltp".into()).stack_size(STACK).spawn(move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(outside)));
        drop(send.send(News::Done(outcome)));
    });
    worker
        .map_err(|e| PyRuntimeError::new_err(format!("the system gave ltp no thread to work on ({e}); try again")))?;
    let outcome = listen(py, inbox, progress);
    interrupted.store(true, Ordering::Relaxed);
    settle(outcome?)
}

/// Waits for the end of the work, with the interpreter released but for signals and progress.
fn listen<T: Send>(
    py: Python<'_>,
    mut inbox: Receiver<News<T>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<thread::Result<Result<T>>> {
    loop {
        let (back, news) = py.detach(move || {
            let news = inbox.recv_timeout(LISTEN);
            (inbox, news)
        });
        inbox = back;
        match news {
            Ok(News::Done(outcome)) => return Ok(outcome),
            Ok(News::Progress(doing, done)) => {
                progress.map(|call| call.call1((doing, done))).transpose()?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(from_panic(&"the worker vanished")),
        }
        py.check_signals()?;
    }
}

/// What came of it, as Python is told.
fn settle<T>(outcome: thread::Result<Result<T>>) -> PyResult<T> {
    match outcome {
        Ok(result) => result.map_err(|error| Failure::from(error).into()),
        Err(panic) => Err(from_panic(&*panic)),
    }
}
