//! Runs the core without holding the interpreter lock: worker threads, interruption, panics.

use crate::cancel::Cancel;
use crate::error::Result;
use crate::simd::Simd;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::ThreadPool;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The interval at which a running render checks for Ctrl-C.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);
/// A larger number of threads is refused as a mistake.
const MAX_THREADS: usize = 1024;

/// The worker threads of a process. A forked child has none of its parent's, so it makes its own.
struct Workers {
    process: u32,
    /// The workers of all renders without a `threads` argument: if they run at the same time, they share the
    /// processors.
    rendering: Option<Arc<ThreadPool>>,
    /// The workers for short work that holds the interpreter lock. The others may be busy for long; waiting for them
    /// while holding the lock would stop all of Python.
    reading: Option<Arc<ThreadPool>>,
    /// The workers that calls with a `threads` argument have left, the longest idle first.
    idle: Vec<Arc<ThreadPool>>,
}

/// The workers of this process. They are accessed under the interpreter lock only, so that no fork comes in between.
fn workers() -> MutexGuard<'static, Workers> {
    const NONE: Workers = Workers { process: 0, rendering: None, reading: None, idle: Vec::new() };
    static WORKERS: Mutex<Workers> = Mutex::new(NONE);
    let mut workers = WORKERS.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if workers.process != process {
        // The threads do not exist in this process, and the locks that telling them to stop would need may be held
        // forever.
        std::mem::forget(std::mem::replace(&mut *workers, Workers { process, ..NONE }));
    }
    workers
}

/// The workers of one call.
struct Team {
    pool: Arc<ThreadPool>,
    own: bool,
}

impl Team {
    /// A team of `threads` workers that no other call uses: the workers of a pool all wait for the work of one call.
    fn of(threads: usize) -> PyResult<Team> {
        let mut workers = workers();
        let found = workers.idle.iter().rposition(|pool| pool.current_num_threads() == threads);
        let pool = match found {
            Some(i) => workers.idle.remove(i),
            None => started(threads)?,
        };
        Ok(Team { pool, own: true })
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        if !self.own {
            return;
        }
        let mut workers = workers();
        workers.idle.push(Arc::clone(&self.pool));
        // No more workers are kept waiting than there are processors, or than have just finished.
        let most = processors().max(self.pool.current_num_threads());
        let mut waiting: usize = workers.idle.iter().map(|pool| pool.current_num_threads()).sum();
        while waiting > most {
            waiting -= workers.idle.remove(0).current_num_threads();
        }
    }
}

/// A pool with as many workers as there are processors for this process.
fn for_all(pool: &mut Option<Arc<ThreadPool>>) -> PyResult<Arc<ThreadPool>> {
    let threads = processors();
    match pool {
        Some(pool) if pool.current_num_threads() == threads => Ok(Arc::clone(pool)),
        _ => Ok(Arc::clone(pool.insert(started(threads)?))),
    }
}

fn started(threads: usize) -> PyResult<Arc<ThreadPool>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("dofsim-{i}"));
    pool.build()
        .map(Arc::new)
        .map_err(|e| PyRuntimeError::new_err(format!("could not start {threads} worker threads: {e}")))
}

/// Number of processors that this process may use.
fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The workers of a call: a team of its own if it asks for a number, otherwise the shared workers.
fn team(threads: Option<usize>) -> PyResult<Team> {
    match threads {
        None => Ok(Team { pool: for_all(&mut workers().rendering)?, own: false }),
        Some(n) if (1..=MAX_THREADS).contains(&n) => Team::of(n),
        Some(n) => Err(PyValueError::new_err(format!("threads must be from 1 to {MAX_THREADS}; got {n}"))),
    }
}

/// Runs short `work` on this process's own workers while the interpreter lock is held. Rayon's global pool would be
/// dead in a forked child.
pub fn installed<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let pool = for_all(&mut workers().reading)?;
    Ok(pool.install(work))
}

/// Whether this thread is the one that Python runs signal handlers in: its main thread.
///
/// Another thread has no reason to take the interpreter lock while it renders. It must not, either: a daemon thread
/// may render while the interpreter ends, and CPython before 3.13 crashes if a thread asks for the lock then.
fn handles_signals(py: Python<'_>) -> bool {
    let ask = || {
        let threading = py.import("threading")?;
        threading.call_method0("get_ident")?.eq(threading.call_method0("main_thread")?.getattr("ident")?)
    };
    // Where the modules are already gone, so are the handlers.
    ask().unwrap_or(false)
}

/// Runs `work` on `threads` workers without the interpreter lock. A signal handler that raises, such as Ctrl-C's,
/// stops the work and its exception is raised.
pub fn detached<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce(&Cancel) -> Result<T> + Send,
) -> PyResult<T> {
    let team = team(threads)?;
    let pool = &*team.pool;
    let cancel = Cancel::default();
    let handles_signals = handles_signals(py);
    py.detach(|| {
        std::thread::scope(|scope| {
            let (sender, receiver) = channel();
            let cancel = &cancel;
            scope.spawn(move || {
                let result = pool.install(|| catch_unwind(AssertUnwindSafe(|| work(cancel))));
                // The receiver lives until it has received the result.
                let _ = sender.send(result);
            });
            let mut interruption = None;
            loop {
                let received = if handles_signals {
                    receiver.recv_timeout(SIGNAL_INTERVAL)
                } else {
                    receiver.recv().map_err(|_| RecvTimeoutError::Disconnected)
                };
                match received {
                    Ok(Ok(result)) => break interruption.map_or_else(|| Ok(result?), Err),
                    Ok(Err(panic)) => break Err(internal_error(panic.as_ref())),
                    Err(RecvTimeoutError::Timeout) => {
                        if let Err(raised) = Python::attach(|py| py.check_signals()) {
                            cancel.cancel();
                            interruption.get_or_insert(raised);
                        }
                    }
                    Err(RecvTimeoutError::Disconnected) => break Err(internal_error(&"the worker is gone")),
                }
            }
        })
    })
}

fn internal_error(panic: &(dyn std::any::Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    PyRuntimeError::new_err(format!(
        "internal error in dofsim, please report it: {}",
        text.unwrap_or("no message")
    ))
}

/// Names of the instruction sets that can be used on this processor, best last.
///
/// The environment variable ``DOFSIM_SIMD`` picks one by name; all give the same bits.
#[pyfunction]
pub fn simd_available() -> Vec<&'static str> {
    Simd::available().into_iter().map(Simd::name).collect()
}

/// The instruction set to use: the best one, or the one that `DOFSIM_SIMD` names.
pub fn simd() -> PyResult<Simd> {
    let available = Simd::available();
    match std::env::var("DOFSIM_SIMD") {
        Err(_) => Ok(available[available.len() - 1]),
        Ok(name) => {
            let usable: Vec<_> = available.into_iter().map(|simd| (simd.name(), simd)).collect();
            super::errors::choice("environment variable DOFSIM_SIMD", &name, &usable)
        }
    }
}
