//! The segments of a map: stable ids, members, moments.

use crate::event::{SegmentEvent, SegmentId};
use crate::moments::{Moments, UNIT};
use crate::surfels::{Cold, Surfels};
use std::collections::BTreeMap;

/// A segment; `slot` in the tables, `id` to the outside, id 0 = the slot is free.
#[derive(Debug, Clone, Default)]
pub(crate) struct Record {
    pub(crate) id: u32,
    /// Of the stable members.
    pub(crate) moments: Moments,
    /// Surfels with this label, unstable ones included.
    pub(crate) members: Vec<u32>,
    /// Stable members when it was last reported as changed.
    pub(crate) reported: u32,
    /// Frame of its creation.
    pub(crate) born: u32,
}

#[derive(Debug, Default)]
pub(crate) struct Segments {
    pub(crate) slots: Vec<Record>,
    free: Vec<u32>,
    /// Ids given so far.
    issued: u32,
    /// Slots touched in this frame, for change events.
    touched: Vec<u32>,
    /// Ids that were merged away, and into which.
    merged: BTreeMap<u32, u32>,
    /// World point of the integer coordinates' zero, metres.
    pub(crate) origin: [f32; 3],
}

impl Segments {
    /// A new segment; `None` once four billion ids are spent.
    pub(crate) fn open(&mut self, frame: u32, events: &mut Vec<SegmentEvent>) -> Option<u32> {
        self.issued = self.issued.checked_add(1)?;
        let record = Record { id: self.issued, born: frame, ..Record::default() };
        events.push(SegmentEvent::Added(SegmentId(self.issued)));
        let slot = self.put(record);
        self.touched.push(slot);
        Some(slot)
    }

    /// A free slot for a record.
    fn put(&mut self, record: Record) -> u32 {
        match self.free.pop() {
            Some(slot) => {
                self.slots[slot as usize] = record;
                slot
            }
            None => {
                self.slots.push(record);
                self.slots.len() as u32 - 1
            }
        }
    }

    /// Closes a slot that lost its last surfel, or never got one.
    pub(crate) fn close(&mut self, slot: u32) {
        let record = &mut self.slots[slot as usize];
        *record = Record::default();
        self.free.push(slot);
    }

    /// Closes the touched slots that are empty, without an event.
    pub(crate) fn close_empty(&mut self) {
        for slot in std::mem::take(&mut self.touched) {
            let record = &self.slots[slot as usize];
            if record.id != 0 && record.members.is_empty() {
                self.close(slot);
            }
        }
    }

    /// The slot of a segment that was open before, or of the one that it was merged into; opened again if need be.
    pub(crate) fn reopen(&mut self, id: SegmentId, frame: u32) -> u32 {
        let mut id = id.0;
        while let Some(&into) = self.merged.get(&id) {
            id = into;
        }
        if let Some(slot) = self.slots.iter().position(|r| r.id == id) {
            return slot as u32;
        }
        // Ids of another run's part stay its own.
        self.issued = self.issued.max(id);
        self.put(Record { id, born: frame, ..Record::default() })
    }

    pub(crate) fn is_open(&self, slot: u32) -> bool {
        self.slots[slot as usize].id != 0
    }

    pub(crate) fn open_slots(&self) -> impl Iterator<Item = &Record> {
        self.slots.iter().filter(|r| r.id != 0)
    }

    pub(crate) fn id(&self, slot: u32) -> SegmentId {
        SegmentId(self.slots[slot as usize].id)
    }

    /// World position in integer coordinates.
    fn counted(&self, p: [f32; 3]) -> [i32; 3] {
        let q = |k: usize| {
            let v = f64::from(p[k] - self.origin[k]) / UNIT;
            (v + 0.5f64.copysign(v)) as i32
        };
        [q(0), q(1), q(2)]
    }

    /// Gives a surfel its segment (slot + 1; 0 = none), moving it out of the old one.
    pub(crate) fn relabel(&mut self, surfels: &mut Surfels, id: u32, segment: u32) {
        let old = std::mem::replace(surfels.segment_mut(id), segment);
        if old != 0 {
            let record = &mut self.slots[old as usize - 1];
            let Cold { counted, place, .. } = surfels.cold[id as usize];
            if surfels.is_stable(id) {
                record.moments.remove(counted);
            }
            record.members.swap_remove(place as usize);
            if let Some(&moved) = record.members.get(place as usize) {
                surfels.cold[moved as usize].place = place;
            }
            self.touched.push(old - 1);
        }
        if segment != 0 {
            let counted = self.counted(surfels.position(id));
            let record = &mut self.slots[segment as usize - 1];
            let stable = surfels.is_stable(id);
            let cold = &mut surfels.cold[id as usize];
            cold.place = record.members.len() as u32;
            cold.counted = counted;
            record.members.push(id);
            if stable {
                record.moments.add(counted);
            }
            self.touched.push(segment - 1);
        }
    }

    /// Counts a surfel that has just become stable in its segment's moments.
    pub(crate) fn ripen(&mut self, surfels: &mut Surfels, id: u32) {
        let segment = surfels.segment(id);
        if segment != 0 {
            let counted = self.counted(surfels.position(id));
            surfels.cold[id as usize].counted = counted;
            self.slots[segment as usize - 1].moments.add(counted);
            self.touched.push(segment - 1);
        }
    }

    /// Brings the moments up to a stable surfel's position once it has moved by more than 1 mm.
    pub(crate) fn follow(&mut self, surfels: &mut Surfels, id: u32) {
        let (segment, position) = (surfels.segment(id), surfels.position(id));
        if segment == 0 || !surfels.is_stable(id) {
            return;
        }
        let cold = &mut surfels.cold[id as usize];
        // Well below 1 mm, without the exact coordinates.
        let near = |k: usize| {
            (position[k] - self.origin[k] - cold.counted[k] as f32 * UNIT as f32).abs() < 8e-4
                && cold.counted[k].unsigned_abs() < 100_000
        };
        if near(0) && near(1) && near(2) {
            return;
        }
        let now = self.counted(position);
        if now.iter().zip(cold.counted).any(|(a, b)| a.abs_diff(b) > 10) {
            let record = &mut self.slots[segment as usize - 1];
            record.moments.remove(cold.counted);
            record.moments.add(now);
            cold.counted = now;
        }
    }

    /// Moves all members of `from` to `into` and closes `from`.
    pub(crate) fn absorb(&mut self, surfels: &mut Surfels, from: u32, into: u32) {
        let moving = std::mem::take(&mut self.slots[from as usize].members);
        self.slots[into as usize].members.reserve(moving.len());
        for id in moving {
            *surfels.segment_mut(id) = 0;
            self.relabel(surfels, id, into + 1);
        }
        self.merged.insert(self.slots[from as usize].id, self.slots[into as usize].id);
        self.close(from);
    }

    /// Reports what this frame did to the touched segments, and closes the empty ones.
    pub(crate) fn settle(&mut self, events: &mut Vec<SegmentEvent>) {
        let mut touched = std::mem::take(&mut self.touched);
        touched.sort_unstable();
        touched.dedup();
        for &slot in &touched {
            let record = &mut self.slots[slot as usize];
            if record.id == 0 {
                continue;
            }
            if record.members.is_empty() {
                events.push(SegmentEvent::Removed(SegmentId(record.id)));
                self.close(slot);
                continue;
            }
            let now = record.moments.count() as u32;
            let share = now.abs_diff(record.reported) as f32 / record.reported.max(1) as f32;
            if share >= 0.1 {
                record.reported = now;
                events.push(SegmentEvent::Changed { id: SegmentId(record.id), share });
            }
        }
        touched.clear();
        self.touched = touched;
    }

    pub(crate) fn bytes(&self) -> usize {
        self.slots.capacity() * size_of::<Record>()
            + self.slots.iter().map(|s| s.members.capacity() * 4).sum::<usize>()
    }
}
