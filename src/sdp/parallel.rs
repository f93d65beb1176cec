use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// `work` for every item on all cores, results in the order of the items. For sweeps: each design is one thread's.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(items.len());
    if threads < 2 {
        return items.iter().map(work).collect();
    }
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::with_capacity(items.len()));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(at) else { break };
                    let made = work(item);
                    // a poisoned lock means that another thread panicked, which the scope passes on
                    if let Ok(mut results) = results.lock() {
                        results.push((at, made));
                    }
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|r| r.0);
    results.into_iter().map(|r| r.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_the_order_of_the_items() {
        let items: Vec<u64> = (0..100).collect();
        assert_eq!(in_parallel(&items, |x| x * x), items.iter().map(|x| x * x).collect::<Vec<_>>());
        assert!(in_parallel(&[] as &[u64], |x| *x).is_empty());
    }
}
