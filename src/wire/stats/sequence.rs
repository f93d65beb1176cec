//! Counting lost frames by their 8-bit sequence numbers.

use super::Source;
use crate::wire::{Check, FrameRef};

/// Further ahead than this is a jump.
const AHEAD: u8 = 64;
/// A number this far behind the newest still counts as late: 300 ms of a vehicle that sends 300 frames a second. Longer
/// would leave too few numbers to know a jump by.
const BEHIND: u8 = 96;
/// Numbers that are remembered; the first power of two above [`BEHIND`].
const MEMORY: u8 = 128;
/// Counters that one sender may run at the same time. Ground stations keep one per link and let both through.
const MAX_COUNTERS: usize = 3;
/// A counter is forgotten when this many frames of the same sender came without it.
const COUNTER_LIFE: u64 = 128;
/// A boot clock that goes back by more than this is a reboot, ms; less is a late frame.
const REBOOT_MS: i32 = -5_000;
/// The SiK radio, which sends in the name of system 51, component 68 and does not count its frames.
const RADIO: Source = Source { system: 51, component: 68 };

/// What became of the frames of one sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Sequence numbers that never came. A lower bound: after 256 frames in a row the numbers start over.
    pub lost: u64,
    /// Frames that came after a later one. Not lost.
    pub late: u64,
    /// Frames that came twice, byte for byte.
    pub duplicates: u64,
    /// Times the boot clock started over. What was lost meanwhile cannot be known and is not counted.
    pub restarts: u64,
    /// What counting `(sequence - expected) mod 256` gives, as pymavlink's `mav_loss` does: a frame that comes one
    /// place late costs 255 or more there, two counters in the name of one sender about 256 for every turn, a reboot a
    /// random number. Unknown messages and the SiK radio are left out, as there.
    pub naive_lost: u64,
}

impl Losses {
    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            lost: self.lost + other.lost,
            late: self.late + other.late,
            duplicates: self.duplicates + other.duplicates,
            restarts: self.restarts + other.restarts,
            naive_lost: self.naive_lost + other.naive_lost,
        }
    }
}

/// Follows the sequence numbers of one sender.
///
/// A frame belongs to the counter that it continues at the least cost: the frames it would leave out, or the places it
/// is late by. A frame that continues none is a jump: the gap counts as lost and a new counter starts behind it. If the
/// old counter then goes on all the same, there are two of them and the gap is taken back. A number that is already
/// taken by another frame is no late frame, so a burst loss of 200 is not mistaken for one that is 56 places late.
#[derive(Debug, Clone, Default)]
pub struct Sequence {
    losses: Losses,
    frames: u64,
    counters: [Option<Counter>; MAX_COUNTERS],
    /// The counter that was used last.
    current: usize,
    boot_ms: Option<u32>,
    /// `losses.lost` when `boot_ms` was seen.
    lost_at_boot_ms: u64,
    naive: Option<u8>,
}

#[derive(Debug, Clone)]
struct Counter {
    /// Newest number.
    head: u8,
    /// Bit i: number `head - i` came.
    came: u128,
    /// Checksum of the frame with number n, at n mod 128.
    checksums: [u16; MEMORY as usize],
    /// `Sequence::frames` when it last took a frame.
    last_used: u64,
    /// How far it has gone since it started.
    age: u64,
    /// The loss that was counted when it started, as long as it may have to be taken back.
    jump: u64,
    /// The counter that was left by that jump.
    left: usize,
    /// It was left by a jump and has gone on this often since; `None` if it is alive.
    left_behind: Option<u8>,
}

/// How a frame continues a counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Forward {
        skipped: u8,
    },
    Late {
        places: u8,
    },
    Repeated,
    /// The number stands still although the frame is another: the sender does not count.
    Stuck,
}

impl Step {
    fn cost(self) -> u8 {
        match self {
            Self::Forward { skipped } => skipped,
            Self::Late { places } => places,
            Self::Repeated | Self::Stuck => 0,
        }
    }
}

impl Counter {
    fn new(number: u8, checksum: u16, last_used: u64, jump: u64, left: usize) -> Self {
        let mut checksums = [0; MEMORY as usize];
        checksums[usize::from(number % MEMORY)] = checksum;
        Self { head: number, came: 1, checksums, last_used, age: 0, jump, left, left_behind: None }
    }

    /// How this frame would continue the counter, if it does.
    fn step(&self, number: u8, checksum: u16) -> Option<Step> {
        let ahead = number.wrapping_sub(self.head);
        let behind = self.head.wrapping_sub(number);
        let same = self.checksums[usize::from(number % MEMORY)] == checksum;
        match (ahead, behind) {
            (0, _) => Some(if same { Step::Repeated } else { Step::Stuck }),
            (1..=AHEAD, _) => Some(Step::Forward { skipped: ahead - 1 }),
            (_, 1..=BEHIND) if self.came >> behind & 1 == 0 => Some(Step::Late { places: behind }),
            (_, 1..=BEHIND) if same => Some(Step::Repeated),
            _ => None,
        }
    }

    fn take(&mut self, step: Step, number: u8, checksum: u16) {
        match step {
            Step::Forward { skipped } => {
                self.came = self.came.checked_shl(u32::from(skipped) + 1).unwrap_or(0) | 1;
                self.head = number;
                self.age += u64::from(skipped) + 1;
            }
            Step::Late { places } => self.came |= 1 << places,
            Step::Repeated | Step::Stuck => {}
        }
        self.checksums[usize::from(number % MEMORY)] = checksum;
    }
}

impl Sequence {
    pub fn losses(&self) -> Losses {
        self.losses
    }

    pub(super) fn frame(&mut self, frame: FrameRef<'_>) {
        self.count_naively(frame);
        self.frames += 1;
        let (number, checksum) = (frame.sequence(), frame.checksum());
        if self.rebooted(frame) {
            self.losses.restarts += 1;
            self.losses.lost = self.lost_at_boot_ms;
            self.counters = Default::default();
        }
        self.forget_old_counters();
        match self.cheapest(number, checksum) {
            Some((index, step)) => self.advance(index, step, number, checksum),
            None => self.jump(number, checksum),
        }
        if let Some(boot_ms) = boot_ms(frame) {
            self.boot_ms = Some(boot_ms);
            self.lost_at_boot_ms = self.losses.lost;
        }
    }

    /// The counter that this frame continues at the least cost; the current one where it costs as little as another. A
    /// counter that was left by a jump is asked last, until it has shown that it is alive.
    fn cheapest(&self, number: u8, checksum: u16) -> Option<(usize, Step)> {
        self.counters
            .iter()
            .enumerate()
            .filter_map(|(index, counter)| {
                let counter = counter.as_ref()?;
                Some((index, counter.step(number, checksum)?, counter.left_behind.is_some()))
            })
            .min_by_key(|&(index, step, left_behind)| (left_behind, step.cost(), index != self.current))
            .map(|(index, step, _)| (index, step))
    }

    fn advance(&mut self, index: usize, step: Step, number: u8, checksum: u16) {
        let Some(counter) = &mut self.counters[index] else { return };
        counter.take(step, number, checksum);
        counter.last_used = self.frames;
        match step {
            Step::Forward { skipped } => {
                self.losses.lost += u64::from(skipped);
                self.current = index;
                self.take_back_jumps_from(index);
            }
            Step::Late { places } => {
                self.losses.late += 1;
                // It was counted as lost by the gap or the jump that it stands in, unless it is older than the counter.
                let in_jump = u64::from(places) > counter.age;
                if !in_jump || counter.jump > 0 {
                    self.losses.lost = self.losses.lost.saturating_sub(1);
                    counter.jump = counter.jump.saturating_sub(u64::from(in_jump));
                }
            }
            Step::Repeated => self.losses.duplicates += 1,
            Step::Stuck => {}
        }
    }

    /// Counter `index` went on. If it had been left by a jump, that was no loss but a second counter: once could be a
    /// late frame, twice is not.
    fn take_back_jumps_from(&mut self, index: usize) {
        let Some(counter) = &mut self.counters[index] else { return };
        let Some(went_on) = &mut counter.left_behind else { return };
        *went_on += 1;
        if *went_on < 2 {
            return;
        }
        counter.left_behind = None;
        for other in self.counters.iter_mut().flatten().filter(|c| c.left == index) {
            self.losses.lost = self.losses.lost.saturating_sub(std::mem::take(&mut other.jump));
        }
    }

    /// Starts a counter behind a gap.
    fn jump(&mut self, number: u8, checksum: u16) {
        let left = self.current;
        let gap = match &mut self.counters[left] {
            Some(counter) => {
                counter.left_behind.get_or_insert(0);
                u64::from(number.wrapping_sub(counter.head).wrapping_sub(1))
            }
            None => 0,
        };
        let place = self.counters.iter().position(Option::is_none).unwrap_or_else(|| self.least_recent());
        // jumps away from the counter that makes room can no longer be taken back
        for counter in self.counters.iter_mut().flatten().filter(|c| c.left == place) {
            counter.jump = 0;
        }
        self.losses.lost += gap;
        self.counters[place] = Some(Counter::new(number, checksum, self.frames, gap, left));
        self.current = place;
    }

    fn least_recent(&self) -> usize {
        let last_used = |counter: &Option<Counter>| counter.as_ref().map_or(0, |c| c.last_used);
        (0..MAX_COUNTERS).min_by_key(|&i| last_used(&self.counters[i])).unwrap_or(0)
    }

    fn forget_old_counters(&mut self) {
        for (index, slot) in self.counters.iter_mut().enumerate() {
            if index != self.current && slot.as_ref().is_some_and(|c| self.frames - c.last_used > COUNTER_LIFE) {
                *slot = None;
            }
        }
    }

    /// Whether the boot clock in this frame started over.
    fn rebooted(&self, frame: FrameRef<'_>) -> bool {
        match (self.boot_ms, boot_ms(frame)) {
            // the wrapping difference also copes with the clock's own wrap after 49 days
            (Some(before), Some(now)) => (now.wrapping_sub(before) as i32) < REBOOT_MS,
            _ => false,
        }
    }

    fn count_naively(&mut self, frame: FrameRef<'_>) {
        let source = Source { system: frame.system_id(), component: frame.component_id() };
        if frame.check() == Check::UnknownMessage || source == RADIO {
            return;
        }
        if let Some(last) = self.naive {
            self.losses.naive_lost += u64::from(frame.sequence().wrapping_sub(last).wrapping_sub(1));
        }
        self.naive = Some(frame.sequence());
    }
}

/// The boot clock, ms, from the messages that nearly every autopilot streams.
fn boot_ms(frame: FrameRef<'_>) -> Option<u32> {
    if frame.check() != Check::Verified {
        return None;
    }
    let fields = frame.fields();
    match frame.message_id() {
        // SYSTEM_TIME: after the 64-bit UTC
        2 => Some(fields.u32(8)),
        // ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT
        30..=33 => Some(fields.u32(0)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};
    use crate::wire::{Encoder, FrameBuf};
    use proptest::prelude::*;

    /// A heartbeat that differs from its neighbours, as frames of a real stream do.
    fn frame(number: u8, content: u32) -> FrameBuf {
        let mut encoder = Encoder::new(1, 1);
        encoder.sequence = number;
        encoder.encode(&HEARTBEAT_DATA { custom_mode: content, ..Default::default() })
    }

    fn attitude(number: u8, time_boot_ms: u32) -> FrameBuf {
        let mut encoder = Encoder::new(1, 1);
        encoder.sequence = number;
        encoder.encode(&ATTITUDE_DATA { time_boot_ms, ..Default::default() })
    }

    /// Losses of a stream whose frames are numbered like this (mod 256), each with its own content.
    fn losses(numbers: impl IntoIterator<Item = u32>) -> Losses {
        let mut sequence = Sequence::default();
        for n in numbers {
            sequence.frame(frame(n as u8, n).as_ref());
        }
        sequence.losses()
    }

    #[test]
    fn numbers_start_over_after_255() {
        assert_eq!(losses(100..1000), Losses::default());
    }

    #[test]
    fn gaps_are_losses() {
        let counted = losses((0..100).chain(103..300).chain(331..400));
        assert_eq!(counted, Losses { lost: 34, naive_lost: 34, ..Default::default() });
    }

    #[test]
    fn late_frames_are_not_lost_however_often() {
        // every tenth frame comes seven places late, as PX4 sends some replies
        let late = |n: u32| n % 10 == 3;
        let stream = (0..2001).flat_map(|n| {
            let held = n >= 7 && late(n - 7);
            [(!late(n)).then_some(n), held.then(|| n - 7)].into_iter().flatten()
        });
        let counted = losses(stream);
        assert_eq!((counted.lost, counted.late), (0, 200));
        // 256 for each, but nothing follows the last of them
        assert_eq!(counted.naive_lost, 200 * 256 - 7);
    }

    #[test]
    fn duplicates_are_told_from_wraps() {
        let mut sequence = Sequence::default();
        for n in 0..300u32 {
            let frame = frame(n as u8, n);
            sequence.frame(frame.as_ref());
            sequence.frame(frame.as_ref());
        }
        assert_eq!((sequence.losses().lost, sequence.losses().duplicates), (0, 300));
    }

    #[test]
    fn a_burst_loss_is_not_a_late_frame() {
        // 231 lost: the next number stands 25 before the last one, but those numbers are taken
        let counted = losses((0..500).chain(731..1500));
        assert_eq!((counted.lost, counted.late), (231, 0));
    }

    #[test]
    fn two_counters_of_one_sender_lose_nothing() {
        // a ground station with two links: 25 Hz on one, 1 Hz on the other, each counting for itself
        let stream = (0..2000u32).flat_map(|n| {
            let other = (n % 25 == 0).then_some(10_000 + 130 + n / 25);
            [Some(n), other].into_iter().flatten()
        });
        let counted = losses(stream);
        assert_eq!(counted.lost, 0);
        assert!(counted.naive_lost > 10_000);
    }

    #[test]
    fn a_reboot_is_not_a_loss() {
        let mut sequence = Sequence::default();
        for n in 0..100u32 {
            sequence.frame(attitude(n as u8, 60_000 + 20 * n).as_ref());
        }
        // the numbers start over, and the first message after the boot does not tell the time
        sequence.frame(frame(0, 0).as_ref());
        for n in 1..100u32 {
            sequence.frame(attitude(n as u8, 20 * n).as_ref());
        }
        let counted = sequence.losses();
        assert_eq!((counted.lost, counted.restarts), (0, 1));
        assert_eq!(counted.naive_lost, 156);
    }

    #[test]
    fn the_boot_clock_may_wrap() {
        let mut sequence = Sequence::default();
        for n in 0..100u32 {
            sequence.frame(attitude(n as u8, (u32::MAX - 1000).wrapping_add(20 * n)).as_ref());
        }
        assert_eq!(sequence.losses(), Losses::default());
    }

    #[test]
    fn a_sender_that_does_not_count_loses_nothing() {
        let mut sequence = Sequence::default();
        for n in 0..100 {
            sequence.frame(frame(0, n).as_ref());
        }
        assert_eq!(sequence.losses().lost, 0);
    }

    proptest! {
        /// Whatever is lost (fewer than 64 in a row), late by up to 14 places or doubled: the count of losses is exact.
        #[test]
        fn losses_are_exact(
            fates in prop::collection::vec((0u8..100, 1u32..15), 300..1200),
            loss in 0u8..40,
        ) {
            let mut arrivals = Vec::new();
            let mut lost_in_row = 0;
            for (n, &(fate, places)) in fates.iter().enumerate() {
                let n = n as u32;
                if n > 20 && fate < loss && lost_in_row < 20 {
                    lost_in_row += 1;
                    continue;
                }
                lost_in_row = 0;
                // late frames arrive just after the frame `places` further on
                let late = n > 20 && fate >= 95;
                arrivals.push((if late { 2 * (n + places) + 1 } else { 2 * n }, n));
                if fate == 94 {
                    arrivals.push((2 * (n + places) + 1, n));
                }
            }
            arrivals.sort();
            let counted = losses(arrivals.iter().map(|&(_, n)| n));
            let mut came: Vec<u32> = arrivals.iter().map(|&(_, n)| n).collect();
            came.sort();
            came.dedup();
            let expected = came.last().unwrap() - came[0] + 1 - came.len() as u32;
            prop_assert_eq!(counted.lost, u64::from(expected));
            prop_assert_eq!(counted.duplicates, (arrivals.len() - came.len()) as u64);
        }
    }
}
