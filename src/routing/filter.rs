use crate::wire::FrameRef;

/// A set of system or component ids.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ids {
    bits: [u64; 4],
}

impl Ids {
    pub fn contains(&self, id: u8) -> bool {
        self.bits[usize::from(id >> 6)] >> (id & 63) & 1 == 1
    }

    pub fn is_empty(&self) -> bool {
        self.bits == [0; 4]
    }
}

impl FromIterator<u8> for Ids {
    fn from_iter<I: IntoIterator<Item = u8>>(ids: I) -> Self {
        let mut set = Self::default();
        for id in ids {
            set.bits[usize::from(id >> 6)] |= 1 << (id & 63);
        }
        set
    }
}

/// Frames by what their header says.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Selection {
    /// Sorted message ids.
    messages: Vec<u32>,
    systems: Ids,
    components: Ids,
}

impl Selection {
    pub fn new(mut messages: Vec<u32>, systems: Ids, components: Ids) -> Self {
        messages.sort_unstable();
        messages.dedup();
        Self { messages, systems, components }
    }

    pub fn is_empty(&self) -> bool {
        self.messages.is_empty() && self.systems.is_empty() && self.components.is_empty()
    }
}

/// Lets frames pass that every given list of `allow` holds and no list of `block`. An empty list allows everything and
/// blocks nothing.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Filter {
    allow: Selection,
    block: Selection,
}

impl Filter {
    pub fn new(allow: Selection, block: Selection) -> Self {
        Self { allow, block }
    }

    /// True if nothing is held back.
    pub fn is_open(&self) -> bool {
        self.allow.is_empty() && self.block.is_empty()
    }

    pub fn passes(&self, frame: FrameRef<'_>) -> bool {
        if self.is_open() {
            return true;
        }
        let (message, system, component) = (frame.message_id(), frame.system_id(), frame.component_id());
        let Self { allow, block } = self;
        let listed = |messages: &[u32]| messages.binary_search(&message).is_ok();
        (allow.messages.is_empty() || listed(&allow.messages))
            && (allow.systems.is_empty() || allow.systems.contains(system))
            && (allow.components.is_empty() || allow.components.contains(component))
            && !listed(&block.messages)
            && !block.systems.contains(system)
            && !block.components.contains(component)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};
    use crate::wire::{Encoder, FrameBuf};

    fn heartbeat(system: u8, component: u8) -> FrameBuf {
        Encoder::new(system, component).encode(&HEARTBEAT_DATA::DEFAULT)
    }

    #[test]
    fn lists_of_allow_all_hold_and_any_of_block_suffices() {
        let attitude = Encoder::new(1, 1).encode(&ATTITUDE_DATA::DEFAULT);
        let allow = Selection::new(vec![30, 0], Ids::from_iter([1, 255]), Ids::default());
        let block = Selection::new(Vec::new(), Ids::default(), Ids::from_iter([191]));
        let filter = Filter::new(allow, block);
        assert!(filter.passes(attitude.as_ref()) && filter.passes(heartbeat(255, 190).as_ref()));
        assert!(!filter.passes(heartbeat(2, 1).as_ref()), "another system");
        assert!(!filter.passes(heartbeat(1, 191).as_ref()), "a blocked component");
        let only_attitude = Filter::new(Selection::new(vec![30], Ids::default(), Ids::default()), Selection::default());
        assert!(!only_attitude.passes(heartbeat(1, 1).as_ref()));
        assert!(Filter::default().passes(heartbeat(0, 0).as_ref()));
    }

    #[test]
    fn every_id_is_its_own() {
        for id in 0..=255u8 {
            let set = Ids::from_iter([id]);
            assert_eq!((0..=255).filter(|&other| set.contains(other)).collect::<Vec<u8>>(), [id]);
        }
    }
}
