use std::sync::{Mutex, MutexGuard, PoisonError};

/// What is inside, also after a panic of another thread: what the daemon locks (counters, times, lists) is true after
/// every step of its writers.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
