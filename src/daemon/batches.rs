//! A bounded queue from many tasks to one thread that takes all there is at once.
//!
//! One lock and one memory copy for each item, and a wake-up only for a receiver that sleeps, or (see [`Wake::Filled`])
//! not even then: a receiver that looks by itself every few milliseconds costs the senders no system call at all. The
//! two buffers are allocated once.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;

/// When a sleeping receiver is woken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wake {
    /// With the first item.
    AtOnce,
    /// When half of the queue is filled; until then it wakes by its own patience.
    Filled,
}

/// Why an item was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refused {
    Full,
    /// The receiver has gone.
    Closed,
}

/// What [`Receiver::take`] brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Took {
    Items,
    /// Nothing came within the patience.
    Nothing,
    /// Every sender has gone and the queue is empty.
    Closed,
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    /// Wakes the receiver.
    filled: Condvar,
    /// Wakes senders that wait for room.
    emptied: Notify,
    senders: AtomicUsize,
    capacity: usize,
    wake_at: usize,
}

#[derive(Debug)]
struct State<T> {
    items: Vec<T>,
    receiver_sleeps: bool,
    receiver_gone: bool,
}

/// Gives items; clones share the queue.
#[derive(Debug)]
pub(super) struct Sender<T>(Arc<Shared<T>>);

/// Takes items.
#[derive(Debug)]
pub(super) struct Receiver<T>(Arc<Shared<T>>);

/// A queue of at most `capacity` items.
pub(super) fn channel<T>(capacity: usize, wake: Wake) -> (Sender<T>, Receiver<T>) {
    let items = Vec::with_capacity(capacity);
    let shared = Arc::new(Shared {
        state: Mutex::new(State { items, receiver_sleeps: false, receiver_gone: false }),
        filled: Condvar::new(),
        emptied: Notify::new(),
        senders: AtomicUsize::new(1),
        capacity,
        wake_at: match wake {
            Wake::AtOnce => 1,
            Wake::Filled => capacity.div_ceil(2),
        },
    });
    (Sender(Arc::clone(&shared)), Receiver(shared))
}

impl<T> Shared<T> {
    /// A panic elsewhere leaves a queue that is still whole: items are pushed and swapped in one step.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, item: T) -> Result<(), (T, Refused)> {
        let mut state = self.lock();
        if state.receiver_gone {
            return Err((item, Refused::Closed));
        }
        if state.items.len() >= self.capacity {
            return Err((item, Refused::Full));
        }
        state.items.push(item);
        let wake = state.receiver_sleeps && state.items.len() >= self.wake_at;
        if wake {
            state.receiver_sleeps = false;
        }
        drop(state);
        if wake {
            self.filled.notify_one();
        }
        Ok(())
    }
}

impl<T> Sender<T> {
    /// Gives an item, or refuses it at once.
    pub(super) fn push(&self, item: T) -> Result<(), Refused> {
        self.0.push(item).map_err(|(_, refused)| refused)
    }

    /// Gives an item as soon as there is room. False if the receiver has gone.
    pub(super) async fn push_when_room(&self, mut item: T) -> bool {
        loop {
            // registered before the attempt, so that room made in between is not missed
            let mut emptied = std::pin::pin!(self.0.emptied.notified());
            emptied.as_mut().enable();
            match self.0.push(item) {
                Ok(()) => return true,
                Err((_, Refused::Closed)) => return false,
                Err((back, Refused::Full)) => item = back,
            }
            emptied.await;
        }
    }
}

impl<T> Clone for Sender<T> {
    fn clone(&self) -> Self {
        self.0.senders.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(&self.0))
    }
}

impl<T> Drop for Sender<T> {
    fn drop(&mut self) {
        if self.0.senders.fetch_sub(1, Ordering::AcqRel) == 1 {
            // under the lock, so that a receiver about to sleep does not miss it
            self.0.lock().receiver_sleeps = false;
            self.0.filled.notify_one();
        }
    }
}

impl<T> Receiver<T> {
    /// Waits at most `patience` for items and moves all of them into `into`, which must be empty.
    pub(super) fn take(&mut self, into: &mut Vec<T>, patience: Duration) -> Took {
        debug_assert!(into.is_empty());
        let shared = &*self.0;
        let mut state = shared.lock();
        let closed = || shared.senders.load(Ordering::Acquire) == 0;
        if state.items.len() < shared.wake_at && !closed() {
            state.receiver_sleeps = true;
            let asleep = |state: &mut State<T>| state.receiver_sleeps && !closed();
            state = match shared.filled.wait_timeout_while(state, patience, asleep) {
                Ok((state, _)) => state,
                Err(poisoned) => poisoned.into_inner().0,
            };
            state.receiver_sleeps = false;
        }
        let was_full = state.items.len() >= shared.capacity;
        into.reserve(shared.capacity);
        std::mem::swap(&mut state.items, into);
        drop(state);
        if was_full {
            shared.emptied.notify_waiters();
        }
        match into.is_empty() {
            false => Took::Items,
            true if closed() => Took::Closed,
            true => Took::Nothing,
        }
    }
}

impl<T> Drop for Receiver<T> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        state.receiver_gone = true;
        state.items.clear();
        drop(state);
        self.0.emptied.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(20);

    #[test]
    fn everything_arrives_once_and_in_order_of_its_sender() {
        for wake in [Wake::AtOnce, Wake::Filled] {
            let (sender, mut receiver) = channel(64, wake);
            let threads: Vec<_> = (0..3)
                .map(|id| {
                    let sender = sender.clone();
                    std::thread::spawn(move || {
                        for k in 0..2_000 {
                            while sender.push((id, k)) == Err(Refused::Full) {
                                std::thread::yield_now();
                            }
                        }
                    })
                })
                .collect();
            drop(sender);
            let (mut next, mut batch) = ([0; 3], Vec::new());
            while receiver.take(&mut batch, Duration::from_millis(2)) != Took::Closed {
                for (id, k) in batch.drain(..) {
                    assert_eq!(k, next[id]);
                    next[id] += 1;
                }
            }
            assert_eq!(next, [2_000; 3]);
            threads.into_iter().for_each(|t| t.join().expect("no panic"));
        }
    }

    #[test]
    fn a_full_queue_refuses_and_a_gone_receiver_too() {
        let (sender, mut receiver) = channel(2, Wake::AtOnce);
        assert_eq!((sender.push(1), sender.push(2), sender.push(3)), (Ok(()), Ok(()), Err(Refused::Full)));
        let mut batch = Vec::new();
        assert_eq!(receiver.take(&mut batch, LONG), Took::Items);
        assert_eq!(batch, [1, 2]);
        batch.clear();
        assert_eq!(receiver.take(&mut batch, Duration::ZERO), Took::Nothing);
        drop(receiver);
        assert_eq!(sender.push(4), Err(Refused::Closed));
    }

    #[test]
    fn the_last_sender_wakes_the_receiver() {
        let (sender, mut receiver) = channel::<u8>(8, Wake::Filled);
        let waiting = std::thread::spawn(move || receiver.take(&mut Vec::new(), LONG));
        std::thread::sleep(Duration::from_millis(20));
        drop(sender);
        assert_eq!(waiting.join().expect("no panic"), Took::Closed);
    }

    #[tokio::test]
    async fn who_waits_for_room_gets_it() {
        let (sender, mut receiver) = channel(1, Wake::AtOnce);
        let filling = tokio::spawn(async move {
            let mut all = true;
            for k in 0..200 {
                all &= sender.push_when_room(k).await;
            }
            (all, sender)
        });
        let reading = tokio::task::spawn_blocking(move || {
            let (mut batch, mut got) = (Vec::new(), Vec::new());
            while got.len() < 200 {
                receiver.take(&mut batch, LONG);
                got.append(&mut batch);
            }
            got
        });
        assert_eq!(reading.await.expect("no panic"), (0..200).collect::<Vec<_>>());
        let (all, sender) = filling.await.expect("no panic");
        assert!(all);
        assert!(!sender.push_when_room(0).await, "nobody takes it any more");
    }
}
