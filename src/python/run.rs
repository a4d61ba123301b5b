//! Running the core off the interpreter lock: worker threads, interruption, panics.

use crate::cancel::Cancel;
use crate::cpu::simd::Simd;
use crate::error::Result;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often a running render looks for Ctrl-C.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);
/// More threads than this are taken for a slip.
const MAX_THREADS: usize = 1024;

/// Pools by process and number of threads.
type Pools = HashMap<(u32, usize), Arc<rayon::ThreadPool>>;

/// The pool of `threads` workers of this process. A forked child has none of its parent's threads, so it makes
/// pools of its own.
fn pool(threads: usize) -> PyResult<Arc<rayon::ThreadPool>> {
    static POOLS: Mutex<Option<Pools>> = Mutex::new(None);
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let pools = pools.get_or_insert_with(HashMap::new);
    let key = (std::process::id(), threads);
    if let Some(pool) = pools.get(&key) {
        return Ok(Arc::clone(pool));
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("dofsim-{i}"))
        .build()
        .map_err(|e| PyRuntimeError::new_err(format!("could not start {threads} worker threads: {e}")))?;
    Ok(Arc::clone(pools.entry(key).or_insert(Arc::new(pool))))
}

/// The number of threads to use: as asked, else one for each processor this process may use.
fn thread_count(threads: Option<usize>) -> PyResult<usize> {
    match threads {
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        Some(n) if (1..=MAX_THREADS).contains(&n) => Ok(n),
        Some(n) => Err(PyValueError::new_err(format!("threads must be from 1 to {MAX_THREADS}; got {n}"))),
    }
}

/// Runs short `work` on this process's own workers while the interpreter lock is held. Rayon's global pool would be
/// dead in a forked child.
pub fn installed<T: Send>(work: impl FnOnce() -> T + Send) -> PyResult<T> {
    Ok(pool(thread_count(None)?)?.install(work))
}

/// Runs `work` on `threads` workers without the interpreter lock. A signal handler that raises, such as Ctrl-C's,
/// stops the work and its exception is raised.
pub fn detached<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    work: impl FnOnce(&Cancel) -> Result<T> + Send,
) -> PyResult<T> {
    let pool = pool(thread_count(threads)?)?;
    let cancel = Cancel::default();
    py.detach(|| {
        std::thread::scope(|scope| {
            let (sender, receiver) = channel();
            let cancel = &cancel;
            scope.spawn(move || {
                let result = pool.install(|| catch_unwind(AssertUnwindSafe(|| work(cancel))));
                // The receiver lives until the result is in.
                let _ = sender.send(result);
            });
            let mut interruption = None;
            loop {
                match receiver.recv_timeout(SIGNAL_INTERVAL) {
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

/// Instruction sets with the names they go by.
const SIMD_NAMES: &[(&str, Simd)] = &[
    ("portable", Simd::Portable),
    #[cfg(target_arch = "x86_64")]
    ("avx2", Simd::Avx2),
    #[cfg(target_arch = "x86_64")]
    ("avx512", Simd::Avx512),
];

/// Names of the instruction sets that the sweep can use on this processor, best last.
///
/// The environment variable ``DOFSIM_SIMD`` picks one by name; all give the same bits.
#[pyfunction]
pub fn simd_available() -> Vec<&'static str> {
    let available = Simd::available();
    SIMD_NAMES.iter().filter(|(_, simd)| available.contains(simd)).map(|(name, _)| *name).collect()
}

/// The instruction set to use: the best one, or the one that `DOFSIM_SIMD` names.
pub fn simd() -> PyResult<Simd> {
    let available = Simd::available();
    match std::env::var("DOFSIM_SIMD") {
        Err(_) => Ok(available[available.len() - 1]),
        Ok(name) => {
            let usable: Vec<_> = SIMD_NAMES.iter().copied().filter(|s| available.contains(&s.1)).collect();
            super::errors::choice("environment variable DOFSIM_SIMD", &name, &usable)
        }
    }
}
