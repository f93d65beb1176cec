use super::limits::Schedule;
use super::{Duplicates, ECHO_US, LinkId, Origin, Rules, TWIN_US};
use crate::wire::FrameRef;
use std::collections::{HashMap, HashSet};

/// Ends of one sender that are remembered; the one silent for longest makes room.
const MOST_HOMES: usize = 64;

/// What became of a received frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// The link takes no such frames.
    Blocked,
    /// It came before from another end.
    Duplicate,
    /// It is taken, and goes to the ends that were given, if any.
    Passed,
    /// Taken and passed on as well, but by another port of a vehicle that is heard elsewhere in the same group of links.
    SecondWay,
    /// Taken and passed on as well, but of another vehicle with the same ids: its sender is heard at another end too, and
    /// the two ends never brought the same frame.
    Twin,
}

/// Who is where, and what holds for each link.
#[derive(Debug)]
pub struct Routes {
    links: Vec<Link>,
    /// The ends that are open, of all links, sorted.
    ends: Vec<Origin>,
    /// Where each (system, component) was heard, in the order of the first time.
    homes: HashMap<(u8, u8), Vec<Home>>,
    /// The components that were heard of each system.
    components: HashMap<u8, Vec<u8>>,
    /// Whom we speak for.
    ourselves: HashSet<(u8, u8)>,
    duplicates: Duplicates,
}

#[derive(Debug, Default)]
struct Link {
    rules: Rules,
    /// The position of the first link with the same group name.
    group: Option<usize>,
    schedule: Schedule,
    /// Frames for this link that its filter or its rate limits held back.
    filtered: u64,
    limited: u64,
}

#[derive(Debug, Clone, Copy)]
struct Home {
    end: Origin,
    heard_us: u64,
    /// Frames that it brought, and those of them that another end brought as well; the older count less.
    seen: u32,
    shared: u32,
}

impl Home {
    fn heard(&mut self, now_us: u64) {
        const ENOUGH: u32 = 256;
        self.heard_us = now_us;
        self.seen += 1;
        if self.seen > ENOUGH {
            (self.seen, self.shared) = (self.seen / 2, self.shared / 2);
        }
    }

    /// Does this end bring the frames of another: two ways to one sender, not two senders? The two ports of one
    /// vehicle, which a group of links may lead to, now and then make the same frame by chance.
    fn confirmed(&self, by_chance: bool) -> bool {
        if by_chance { self.shared >= 4 && self.shared * 4 >= self.seen } else { self.shared > 0 }
    }
}

impl Routes {
    /// `rules[i]` belongs to `LinkId(i)`. `window_us` is how long duplicates are known.
    pub fn new(rules: Vec<Rules>, window_us: u64) -> Self {
        let mut routes = Self {
            links: rules.into_iter().map(|rules| Link { rules, ..Link::default() }).collect(),
            ends: Vec::new(),
            homes: HashMap::new(),
            components: HashMap::new(),
            ourselves: HashSet::new(),
            duplicates: Duplicates::new(window_us),
        };
        routes.regroup();
        routes
    }

    /// Other rules for a link from now on.
    pub fn set_rules(&mut self, link: LinkId, rules: Rules) {
        if let Some(known) = self.links.get_mut(link.0) {
            known.rules = rules;
        }
        self.regroup();
    }

    fn regroup(&mut self) {
        let name = |link: &Link| link.rules.group.clone();
        for at in 0..self.links.len() {
            let own = name(&self.links[at]);
            self.links[at].group = own.and_then(|own| self.links.iter().position(|l| name(l).as_ref() == Some(&own)));
        }
    }

    /// Another window from now on.
    pub fn set_window(&mut self, window_us: u64) {
        if self.duplicates.window_us() != window_us {
            self.duplicates = Duplicates::new(window_us);
        }
    }

    /// An end that frames can go to.
    pub fn open(&mut self, end: Origin) {
        if let Err(at) = self.ends.binary_search(&end) {
            self.ends.insert(at, end);
        }
    }

    /// An end has gone, and with it whoever lived there.
    pub fn close(&mut self, end: Origin) {
        self.ends.retain(|e| *e != end);
        let (homes, components) = (&mut self.homes, &mut self.components);
        homes.retain(|&(system, component), at| {
            at.retain(|home| home.end != end);
            if at.is_empty()
                && let Some(known) = components.get_mut(&system)
            {
                known.retain(|c| *c != component);
            }
            !at.is_empty()
        });
    }

    /// Frames that a link's filter and its rate limits held back on their way out.
    pub fn held_back(&self, link: LinkId) -> (u64, u64) {
        self.links.get(link.0).map_or((0, 0), |l| (l.filtered, l.limited))
    }

    /// One of our own frames leaves: it is known if it comes back, and its sender is here.
    pub fn sent(&mut self, frame: FrameRef<'_>, now_us: u64) {
        self.ourselves.insert((frame.system_id(), frame.component_id()));
        self.duplicates.seen(frame, None, now_us);
    }

    /// Learns from a frame and finds the ends that it goes to, each once; `to` is cleared first.
    ///
    /// Allocates only when a new sender or end is met.
    pub fn route(&mut self, frame: FrameRef<'_>, from: Origin, now_us: u64, to: &mut Vec<Origin>) -> Fate {
        to.clear();
        if self.links.get(from.link.0).is_some_and(|link| !link.rules.inward.passes(frame)) {
            return Fate::Blocked;
        }
        let source = (frame.system_id(), frame.component_id());
        self.learn(source, from, now_us);
        if let Some(first) = self.duplicates.seen(frame, Some(from), now_us) {
            self.confirm(source, [Some(from), first.from]);
            return Fate::Duplicate;
        }
        self.addressees(frame, to);
        let homes = self.homes.get(&source).map_or(&[][..], Vec::as_slice);
        let lately = |home: &Home| now_us.saturating_sub(home.heard_us) <= ECHO_US;
        let links = &self.links;
        to.retain(|&end| {
            end != from && !homes.iter().any(|home| lately(home) && (home.end == end || grouped(links, home.end, end)))
        });
        // the filter and the limits of a link are asked once, for all its ends; those stand together
        let mut last: Option<(LinkId, bool)> = None;
        to.retain(|end| {
            if let Some((link, passes)) = last
                && link == end.link
            {
                return passes;
            }
            let passes = self.links.get_mut(end.link.0).is_some_and(|link| link.passes(frame, now_us));
            last = Some((end.link, passes));
            passes
        });
        match self.other_first(source, from, now_us) {
            Some(first) if grouped(&self.links, first, from) => Fate::SecondWay,
            Some(_) => Fate::Twin,
            None => Fate::Passed,
        }
    }

    /// Two ends lead to one sender.
    fn confirm(&mut self, source: (u8, u8), ends: [Option<Origin>; 2]) {
        for home in self.homes.get_mut(&source).into_iter().flatten() {
            if ends.contains(&Some(home.end)) {
                home.shared += 1;
            }
        }
    }

    /// The end where a sender with these ids was heard first and still is, if that is not this one and nothing shows
    /// that both are the same sender. Without a window for duplicates nobody can tell.
    fn other_first(&self, source: (u8, u8), from: Origin, now_us: u64) -> Option<Origin> {
        let homes = self.homes.get(&source).filter(|homes| homes.len() > 1)?;
        let lately = |home: &&Home| now_us.saturating_sub(home.heard_us) <= TWIN_US;
        let first = homes.iter().find(lately)?.end;
        let here = homes.iter().find(|home| home.end == from)?;
        let by_chance = grouped(&self.links, first, from);
        (self.duplicates.window_us() > 0 && first != from && !here.confirmed(by_chance)).then_some(first)
    }

    /// The ends where the addressee lives, or all of them if it is everyone. Ends of one link stand together.
    fn addressees(&self, frame: FrameRef<'_>, to: &mut Vec<Origin>) {
        let Some((system, component)) = frame.target().filter(|(system, _)| *system != 0) else {
            to.extend_from_slice(&self.ends);
            return;
        };
        if component != 0 {
            self.homes_of((system, component), to);
        }
        if to.is_empty() && !self.ourselves.contains(&(system, component)) {
            let known = self.components.get(&system).into_iter().flatten();
            known.for_each(|&component| self.homes_of((system, component), to));
        }
        to.sort_unstable();
        to.dedup();
        to.retain(|end| self.ends.binary_search(end).is_ok());
    }

    /// Adds the ends that lead to a component.
    fn homes_of(&self, source: (u8, u8), to: &mut Vec<Origin>) {
        for home in self.homes.get(&source).into_iter().flatten() {
            to.push(home.end);
            if self.links.get(home.end.link.0).is_some_and(|link| link.group.is_some()) {
                to.extend(self.ends.iter().filter(|&&end| grouped(&self.links, home.end, end)));
            }
        }
    }

    fn learn(&mut self, source: (u8, u8), end: Origin, now_us: u64) {
        let at = self.homes.entry(source).or_insert_with(|| {
            self.components.entry(source.0).or_default().push(source.1);
            Vec::new()
        });
        if let Some(home) = at.iter_mut().find(|home| home.end == end) {
            home.heard(now_us);
            return;
        }
        if at.len() >= MOST_HOMES
            && let Some(oldest) = (0..at.len()).min_by_key(|&i| at[i].heard_us)
        {
            at.remove(oldest);
        }
        at.push(Home { end, heard_us: now_us, seen: 1, shared: 0 });
    }
}

impl Link {
    fn passes(&mut self, frame: FrameRef<'_>, now_us: u64) -> bool {
        if !self.rules.outward.passes(frame) {
            self.filtered += 1;
            return false;
        }
        let passes = self.schedule.pass(&self.rules.limits, frame, now_us);
        self.limited += u64::from(!passes);
        passes
    }
}

/// Whether both ends belong to one group of links.
fn grouped(links: &[Link], a: Origin, b: Origin) -> bool {
    let group = |end: Origin| links.get(end.link.0).and_then(|link| link.group);
    group(a).is_some() && group(a) == group(b)
}
