//! The compared systems, and the local graphs that all of them start from.

mod frames;
mod local;
mod multi;
mod oracle;
mod rules;
mod single;

pub use frames::AgentFrames;
pub use local::{Clocks, Local, LocalParams, Revision, Variant, run_visit};
pub use multi::{MultiParams, multi_agent};
pub use rules::{majority_scores, rule_scores};
pub use single::single_agent;

use crate::changes::Changes;
use graph_align::SceneGraph;

/// A system's name and kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum System {
    /// One agent, a revisit replaces the room.
    Sgfn,
    /// One agent, everything is appended.
    SgfnKeep,
    /// The robust algorithm.
    Ma3dsg,
    /// The paper's algorithm.
    Paper,
    /// No alignment.
    Append,
    /// True association and removal.
    Oracle,
    /// The same, but what one visit shows in several pieces stays in pieces.
    OracleVisits,
    /// One agent, plane and height rules instead of a network.
    Rules,
    /// One agent, always the commonest answer.
    Majority,
    /// One agent, true labels and predicates on our segments.
    OracleLabels,
    /// One agent, our labels and predicates on true segments.
    OracleSegments,
}

impl System {
    /// All of them, in the order of tables.
    pub const ALL: [Self; 11] = [
        Self::Sgfn,
        Self::SgfnKeep,
        Self::Ma3dsg,
        Self::Paper,
        Self::Append,
        Self::Oracle,
        Self::OracleVisits,
        Self::Rules,
        Self::Majority,
        Self::OracleLabels,
        Self::OracleSegments,
    ];

    /// As in flags, files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sgfn => "sgfn",
            Self::SgfnKeep => "sgfn-keep",
            Self::Ma3dsg => "ma3dsg",
            Self::Paper => "ma3dsg-paper",
            Self::Append => "ma3dsg-append",
            Self::Oracle => "ma3dsg-oracle",
            Self::OracleVisits => "ma3dsg-oracle-visits",
            Self::Rules => "rules",
            Self::Majority => "majority",
            Self::OracleLabels => "ceiling-oracle-labels",
            Self::OracleSegments => "ceiling-oracle-segments",
        }
    }

    /// The system of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// True where several agents exchange graphs.
    #[must_use]
    pub fn is_multi_agent(self) -> bool {
        self.is_oracle() || matches!(self, Self::Ma3dsg | Self::Paper | Self::Append)
    }

    /// True where the merge knows the true instances.
    #[must_use]
    pub fn is_oracle(self) -> bool {
        matches!(self, Self::Oracle | Self::OracleVisits)
    }

    /// True where agents have to find out how their frames lie to one another.
    #[must_use]
    pub fn needs_frames(self) -> bool {
        self.is_multi_agent() && !self.is_oracle()
    }

    /// Which local graphs it is made of.
    #[must_use]
    pub fn variant(self) -> Variant {
        match self {
            Self::Ma3dsg => Variant::Full,
            Self::Rules => Variant::Rules,
            Self::Majority => Variant::Majority,
            Self::OracleLabels => Variant::OracleLabels,
            Self::OracleSegments => Variant::OracleSegments,
            _ => Variant::Network,
        }
    }
}

/// What a system made of a scenario.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// In the domain frame.
    pub graph: SceneGraph,
    /// Visits that were used.
    pub visits: usize,
    /// Frames that were used.
    pub frames: u64,
    /// Frames of the busiest agent.
    pub frames_max_agent: u64,
    /// Exchange, for several agents.
    pub exchange: Option<Exchange>,
    /// CPU seconds of the slowest agent, or of the only one.
    pub total_cpu_s: f64,
    /// Wall-clock seconds of the visits that were used, one after the other, and of merging.
    pub total_wall_s: f64,
    /// Rendering and decoding of the visits that were used.
    pub world_s: f64,
}

/// Costs and outcome of exchanging graphs.
#[derive(Clone, Debug, Default)]
pub struct Exchange {
    /// Bytes sent per agent, a broadcast counted once.
    pub bytes: Vec<u64>,
    /// Bytes sent per agent, every copy counted.
    pub copies: Vec<u64>,
    /// CPU seconds to build one replica once.
    pub align_s: f64,
    /// The same for all replicas.
    pub align_s_all: f64,
    /// CPU seconds that agent 0 spent on folding again because something came late.
    pub refold_s: f64,
    /// Whether all replicas hold the same and fold to the same graph.
    pub replicas_equal: bool,
    /// Links between agents (found, true, wrong) where frames are unknown.
    pub links: Option<[usize; 3]>,
    /// Revisions that travelled as what changed, and those of them that met no base.
    pub deltas: fleet::Deltas,
    /// What the folds made of changes, where there were any.
    pub changes: Option<Changes>,
    /// Frames as sent.
    pub wire: Vec<Vec<u8>>,
}
