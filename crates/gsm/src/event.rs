//! What a frame did: counts, skips and segment events.

/// Name of a segment; given once, never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SegmentId(pub u32);

impl std::fmt::Display for SegmentId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "s{}", self.0)
    }
}

/// A change of the set of segments.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum SegmentEvent {
    /// A segment began.
    Added(SegmentId),
    /// The number of its stable surfels changed by this share (at least 0.1) since the last report.
    Changed {
        /// The segment.
        id: SegmentId,
        /// |now − reported| / reported.
        share: f32,
    },
    /// All surfels of `from` went over to `into`; `from` is gone.
    Merged {
        /// The segment that ended.
        from: SegmentId,
        /// The segment that lives on.
        into: SegmentId,
    },
    /// A part of `from` became `into`, whose `Added` comes just before.
    Split {
        /// The segment that lost the part.
        from: SegmentId,
        /// The new segment.
        into: SegmentId,
    },
    /// The segment lost its last surfel.
    Removed(SegmentId),
}

/// Why a frame was not integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Skip {
    /// The pose is not finite, not a rotation, or farther than 100 km from the origin.
    InvalidPose,
    /// The depth slice is not `width * height` long.
    WrongSize,
    /// Fewer than ten working pixels hold valid depth.
    NoDepth,
}

/// Numbers of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Working columns and rows.
    pub working_size: (u32, u32),
    /// Samples that the map learns from: pixels, or blocks of pixels.
    pub samples: u32,
    /// Working pixels with valid depth.
    pub valid: u32,
    /// Regions found in the frame.
    pub regions: u32,
    /// Bricks in view.
    pub bricks: u32,
    /// Surfels in these bricks.
    pub visited: u32,
    /// Surfels that were seen again.
    pub matched: u32,
    /// Surfels made.
    pub created: u32,
    /// Unstable surfels that timed out.
    pub expired: u32,
    /// Surfels removed because the camera looked through them.
    pub contradicted: u32,
    /// Surfels and bricks refused because the map is full.
    pub refused: u32,
    /// Live surfels after the frame.
    pub surfels: u32,
    /// Live segments after the frame.
    pub segments: u32,
}

/// What [`Map::integrate`](crate::Map::integrate) did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameReport {
    /// Set when the frame was left out; then nothing else changed.
    pub skipped: Option<Skip>,
    /// The camera moved farther than [`Params::jump`](crate::Params::jump) since the last good frame.
    pub jumped: bool,
    /// Numbers.
    pub counts: Counts,
    /// Events in the order in which they happened.
    pub events: Vec<SegmentEvent>,
}
