//! Who visits which scan, and when (BENCH.md section 1).

use crate::{Error, seeds};
use scan3r::Dataset;

/// Static (reference scans alone) or long-term dynamic (then every rescan).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scenario {
    /// Static complete perception.
    Scp,
    /// Long-term dynamic perception.
    Ldcp,
}

impl Scenario {
    /// As in files and flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scp => "scp",
            Self::Ldcp => "ldcp",
        }
    }
}

/// How agents' frames relate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramesMode {
    /// One exact frame.
    Shared,
    /// One frame up to a small offset per agent and a random walk of its poses.
    Drift,
    /// A frame per agent.
    Unknown,
    /// A frame per visit.
    UnknownVisit,
}

impl FramesMode {
    /// All modes.
    pub const ALL: [Self; 4] = [Self::Shared, Self::Drift, Self::Unknown, Self::UnknownVisit];

    /// As in files and flags.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Shared => "shared",
            Self::Drift => "drift",
            Self::Unknown => "unknown",
            Self::UnknownVisit => "unknown-visit",
        }
    }

    /// The mode of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }
}

/// What recorded data, which holds one sequence per scan, gives to two visitors of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replay {
    /// The first and the last 60 % of the frames.
    Halves,
    /// The whole sequence to both.
    Same,
}

/// What to plan.
#[derive(Clone, Debug)]
pub struct PlanParams {
    /// Number of rooms.
    pub rooms: usize,
    /// Number of agents K.
    pub agents: usize,
    /// Wanted overlap ratio rho, 0 to 1.
    pub overlap: f64,
    /// Which scans.
    pub scenario: Scenario,
    /// Add shared rooms until all agents are connected.
    pub connect: bool,
    /// What recorded data gives to two visitors.
    pub replay: Replay,
    /// Root seed.
    pub seed: u64,
}

/// One pass through one scan.
#[derive(Clone, Debug, PartialEq)]
pub struct Visit {
    /// Who.
    pub agent: usize,
    /// Room index within the domain.
    pub room: usize,
    /// Scan id.
    pub scan: String,
    /// 0 = reference scan, k = k-th rescan of the room.
    pub round: usize,
    /// Which pass through this scan: seeds the camera path of generated data.
    pub pass: u64,
    /// Frames that are used, as a range of the stream.
    pub frames: std::ops::Range<u32>,
    /// Start on the simulated clock, seconds.
    pub start: f64,
    /// Number of this visit among its agent's, from 0.
    pub seq: u32,
}

impl Visit {
    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.frames.end - self.frames.start
    }

    /// True without frames.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// End on the simulated clock: a frame takes 0.2 s.
    #[must_use]
    pub fn end(&self) -> f64 {
        self.start + f64::from(self.len()) / scan3r::sequence::FRAMES_PER_SECOND
    }
}

/// All visits of a scenario, by start time, then agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Visits.
    pub visits: Vec<Visit>,
    /// Number of agents.
    pub agents: usize,
    /// 2S / V of the round-0 visits.
    pub overlap_measured: f64,
}

/// Deals rooms to agents.
///
/// # Errors
/// No room or agent, more rooms than the data has, an overlap outside 0..1.
pub fn plan(data: &dyn Dataset, p: &PlanParams) -> Result<Plan, Error> {
    check(data, p)?;
    let n = p.rooms;
    let mut builder =
        Builder { data, p, visits: Vec::new(), clock: vec![0.0; p.agents], seq: vec![0; p.agents] };
    let owners = builder.deal()?;
    let shared = owners.iter().filter(|o| o.len() == 2).count();
    let total: usize = owners.iter().map(Vec::len).sum();
    builder.round_zero(&owners)?;
    if p.scenario == Scenario::Ldcp {
        builder.rescans(n)?;
    }
    let mut visits = builder.visits;
    visits.sort_by(|a, b| a.start.total_cmp(&b.start).then(a.agent.cmp(&b.agent)));
    Ok(Plan { visits, agents: p.agents, overlap_measured: 2.0 * shared as f64 / total as f64 })
}

fn check(data: &dyn Dataset, p: &PlanParams) -> Result<(), Error> {
    let there = data.rooms().len();
    if p.rooms == 0 || p.rooms > there {
        return Err(Error::parameter("domain", format!("{} rooms, the data has {there}", p.rooms)));
    }
    if p.agents == 0 || p.agents > 1000 {
        return Err(Error::parameter("agents", format!("{}, want 1 to 1000", p.agents)));
    }
    if !(0.0..=1.0).contains(&p.overlap) {
        return Err(Error::parameter("overlap", format!("{}, want 0 to 1", p.overlap)));
    }
    Ok(())
}

/// S = round(rho N / (2 - rho)), at least 1 where anything can be shared.
#[must_use]
pub fn shared_rooms(rooms: usize, agents: usize, overlap: f64) -> usize {
    if agents < 2 || overlap <= 0.0 {
        return 0;
    }
    let s = (overlap * rooms as f64 / (2.0 - overlap)).round() as usize;
    s.max(usize::from(rooms >= 2)).min(rooms)
}

struct Builder<'a> {
    data: &'a dyn Dataset,
    p: &'a PlanParams,
    visits: Vec<Visit>,
    clock: Vec<f64>,
    seq: Vec<u32>,
}

impl Builder<'_> {
    /// Owners per room: one agent, or two for shared rooms; each time the agent with the fewest
    /// frames so far.
    fn deal(&self) -> Result<Vec<Vec<usize>>, Error> {
        let (n, k) = (self.p.rooms, self.p.agents);
        let mut order: Vec<usize> = (0..n).collect();
        seeds::shuffle(&mut order, &mut seeds::stream(self.p.seed, "deal", &[]));
        let mut load = vec![0_u64; k];
        let mut owners = vec![Vec::new(); n];
        for &room in &order {
            let scan = &self.data.rooms()[room].reference;
            let agent = (0..k).min_by_key(|&a| (load[a], a)).unwrap_or(0);
            load[agent] += u64::from(self.data.frame_count(scan, 0)?);
            owners[room].push(agent);
        }
        let mut second = order;
        seeds::shuffle(&mut second, &mut seeds::stream(self.p.seed, "share", &[]));
        let wanted = shared_rooms(n, k, self.p.overlap);
        let mut shared = 0;
        for &room in &second {
            if shared >= wanted && !(self.p.connect && components(&owners, k) > 1) {
                break;
            }
            let parts = group_of(&owners, k);
            let first = owners[room][0];
            let busy = |a: usize| owners.iter().flatten().any(|&o| o == a);
            // While agents are to be connected, a room goes to another group where there is one; an
            // idle agent or one of the same group would use it up for nothing.
            let connects = |a: usize| self.p.connect && parts[a] != parts[first] && busy(a);
            let connecting = (0..k).any(connects);
            let candidates =
                (0..k).filter(|&a| a != first && if connecting { connects(a) } else { shared < wanted });
            if let Some(agent) = candidates.min_by_key(|&a| (load[a], a)) {
                load[agent] += u64::from(self.data.frame_count(&self.data.rooms()[room].reference, 1)?);
                owners[room].push(agent);
                shared += 1;
            }
        }
        Ok(owners)
    }

    fn round_zero(&mut self, owners: &[Vec<usize>]) -> Result<(), Error> {
        for agent in 0..self.p.agents {
            let mut rooms: Vec<usize> = (0..owners.len()).filter(|&r| owners[r].contains(&agent)).collect();
            seeds::shuffle(&mut rooms, &mut seeds::stream(self.p.seed, "trajectory", &[agent as u64]));
            for room in rooms {
                let pass = owners[room].iter().position(|&a| a == agent).unwrap_or(0) as u64;
                let twice = owners[room].len() == 2;
                let start = self.clock[agent];
                self.visit(agent, room, 0, pass, twice, start)?;
            }
        }
        Ok(())
    }

    /// Every rescan of every room in the order of the file, each by the agent whose clock is lowest,
    /// never twice in a row by the same agent where there are several.
    fn rescans(&mut self, rooms: usize) -> Result<(), Error> {
        let longest = self.data.rooms()[..rooms].iter().map(|r| r.scans.len()).max().unwrap_or(0);
        for round in 1..=longest {
            for room in 0..rooms {
                if self.data.rooms()[room].scans.len() < round {
                    continue;
                }
                let last = self
                    .visits
                    .iter()
                    .filter(|v| v.room == room)
                    .max_by(|a, b| a.end().total_cmp(&b.end()).then(a.agent.cmp(&b.agent)));
                let (before, free) = last.map_or((usize::MAX, 0.0), |v| (v.agent, v.end()));
                let agent = (0..self.p.agents)
                    .filter(|&a| a != before || self.p.agents == 1)
                    .min_by(|&a, &b| self.clock[a].total_cmp(&self.clock[b]).then(a.cmp(&b)))
                    .unwrap_or(0);
                let start = self.clock[agent].max(free);
                self.visit(agent, room, round, 0, false, start)?;
            }
        }
        Ok(())
    }

    fn visit(
        &mut self,
        agent: usize,
        room: usize,
        round: usize,
        pass: u64,
        twice: bool,
        start: f64,
    ) -> Result<(), Error> {
        let entry = &self.data.rooms()[room];
        let scan = if round == 0 { &entry.reference } else { &entry.scans[round - 1].id };
        let count = self.data.frame_count(scan, pass)?;
        let part = (f64::from(count) * 0.6).ceil() as u32;
        let halves = twice && self.p.replay == Replay::Halves && !self.data.has_own_path_per_visit();
        let frames = match (halves, pass) {
            (false, _) => 0..count,
            (true, 0) => 0..part,
            (true, _) => count - part..count,
        };
        let v = Visit { agent, room, scan: scan.clone(), round, pass, frames, start, seq: self.seq[agent] };
        self.clock[agent] = v.end();
        self.seq[agent] += 1;
        self.visits.push(v);
        Ok(())
    }
}

/// Representative of each agent's group; agents that share a room are of one group.
fn group_of(owners: &[Vec<usize>], agents: usize) -> Vec<usize> {
    let mut group: Vec<usize> = (0..agents).collect();
    for o in owners.iter().filter(|o| o.len() == 2) {
        let (a, b) = (group[o[0]].min(group[o[1]]), group[o[0]].max(group[o[1]]));
        group.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
    }
    group
}

/// Number of groups among agents that have a room at all.
fn components(owners: &[Vec<usize>], agents: usize) -> usize {
    let group = group_of(owners, agents);
    let mut busy: Vec<usize> = owners.iter().flatten().map(|&a| group[a]).collect();
    busy.sort_unstable();
    busy.dedup();
    busy.len()
}
