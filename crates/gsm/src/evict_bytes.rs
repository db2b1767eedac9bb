//! [`Evicted`] as bytes, for a file or another process of the same robot.
//!
//! Little endian: `MGE1`, number of bricks u32; per brick: key 3 × i32, octants looked through u8, octants with a
//! surface u8, number of surfels u32; per surfel (47 bytes): position 3 × f32, radius f32, normal 3 × f32, segment's id
//! u32 (0 = none), frame of the last sighting u32, frame that made it u32, confidence f32, confidence of its label i16,
//! stable u8 (0 or 1). Nothing follows. Labels' tags of a split in progress are not kept.

use crate::Error;
use crate::correct::Whole;
use crate::evict::{Evicted, Part};
use crate::surfels::{Cold, Hot};

const MAGIC: [u8; 4] = *b"MGE1";
const BRICK: usize = 18;
const SURFEL: usize = 47;
/// Coordinates lie within this, metres: as far as poses may.
const FAR: f32 = 2e5;

impl Evicted {
    /// As bytes; the layout is in the source of this module and stable within its version.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(8 + BRICK * self.bricks.len() + SURFEL * self.surfels());
        out.extend(MAGIC);
        out.extend((self.bricks.len() as u32).to_le_bytes());
        for part in &self.bricks {
            part.key.iter().for_each(|k| out.extend(k.to_le_bytes()));
            out.extend([part.through, part.surface]);
            out.extend((part.surfels.len() as u32).to_le_bytes());
            part.surfels.iter().for_each(|(whole, segment)| write(&mut out, whole, *segment));
        }
        out
    }

    /// Reads what [`to_bytes`](Self::to_bytes) wrote.
    ///
    /// # Errors
    /// [`Error::Evicted`] names the first byte that is not as the format has it. Memory is taken only for what the
    /// bytes hold.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Error> {
        let mut r = Reader { bytes, at: 0 };
        if r.take::<4>()? != MAGIC {
            return Err(Error::Evicted { at: 0, problem: "not an MGE1 file" });
        }
        let n = r.number(BRICK)?;
        let mut bricks = Vec::with_capacity(n);
        for _ in 0..n {
            let key = [r.i32()?, r.i32()?, r.i32()?];
            r.check(key.iter().all(|k| k.unsigned_abs() < 1_000_000), "a brick too far off")?;
            let [through, surface] = r.take()?;
            r.check(through & surface == 0, "an octant both looked through and with a surface")?;
            let m = r.number(SURFEL)?;
            let surfels = (0..m).map(|_| r.surfel()).collect::<Result<_, _>>()?;
            bricks.push(Part { key, through, surface, surfels });
        }
        r.check(r.at == bytes.len(), "bytes after the end")?;
        Ok(Self { bricks })
    }
}

fn write(out: &mut Vec<u8>, whole: &Whole, segment: u32) {
    let Whole { hot, cold, confidence, label_confidence, stable } = whole;
    let [x, y, z] = hot.position;
    let [nx, ny, nz] = hot.normal;
    [x, y, z, hot.radius, nx, ny, nz].iter().for_each(|v| out.extend(v.to_le_bytes()));
    [segment, cold.seen, cold.made].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(confidence.to_le_bytes());
    out.extend(label_confidence.to_le_bytes());
    out.push(u8::from(*stable));
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let part = self.bytes.get(self.at..).and_then(|b| b.first_chunk::<N>()).copied();
        self.at += N;
        part.ok_or(Error::Evicted { at: self.bytes.len(), problem: "the end, where more was announced" })
    }

    fn check(&self, holds: bool, problem: &'static str) -> Result<(), Error> {
        if holds { Ok(()) } else { Err(Error::Evicted { at: self.at, problem }) }
    }

    fn i32(&mut self) -> Result<i32, Error> {
        self.take().map(i32::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, Error> {
        self.take().map(u32::from_le_bytes)
    }

    fn f32(&mut self, most: f32) -> Result<f32, Error> {
        let v = self.take().map(f32::from_le_bytes)?;
        self.check(v.abs() <= most, "a number out of range")?;
        Ok(v)
    }

    /// A number of things of `size` bytes, for which there must be room.
    fn number(&mut self, size: usize) -> Result<usize, Error> {
        let n = self.u32()? as usize;
        self.check(n <= (self.bytes.len() - self.at) / size, "more announced than there is room for")?;
        Ok(n)
    }

    fn surfel(&mut self) -> Result<(Whole, u32), Error> {
        let position = [self.f32(FAR)?, self.f32(FAR)?, self.f32(FAR)?];
        let radius = self.f32(10.0)?;
        self.check(radius > 0.0, "a radius that is not positive")?;
        let normal = [self.f32(2.0)?, self.f32(2.0)?, self.f32(2.0)?];
        let segment = self.u32()?;
        self.check(segment < 1 << 31, "a segment's id out of range")?;
        let (seen, made) = (self.u32()?, self.u32()?);
        let confidence = self.f32(1e3)?;
        let label_confidence = self.take().map(i16::from_le_bytes)?;
        let [stable] = self.take()?;
        self.check(stable <= 1, "a flag that is neither 0 nor 1")?;
        let hot = Hot { position, radius, normal, segment: 0 };
        let cold = Cold { seen, made, ..Cold::default() };
        Ok((Whole { hot, cold, confidence, label_confidence, stable: stable == 1 }, segment))
    }
}
