use std::sync::{Mutex, MutexGuard, PoisonError};

/// What is inside, also after a panic of another thread: what is locked so (counters, times, lists) is true
/// after every step of its writers.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
