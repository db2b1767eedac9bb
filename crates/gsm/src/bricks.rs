//! Space in cubes of some 0.25 m: each brick owns blocks of surfels and remembers what was looked through.

use crate::surfels::Block;

/// One cube of the map.
#[derive(Debug, Clone, Default)]
pub(crate) struct Brick {
    pub(crate) key: [i32; 3],
    pub(crate) blocks: Vec<Block>,
    /// Octants (bit = x + 2y + 4z) whose centre was last seen through / holding a surface.
    pub(crate) through: u8,
    pub(crate) surface: u8,
}

/// Bricks by integer coordinates: open addressing over a table of brick numbers.
#[derive(Debug)]
pub(crate) struct Bricks {
    pub(crate) side: f32,
    pub(crate) list: Vec<Brick>,
    table: Vec<u32>,
    limit: usize,
}

const EMPTY: u32 = u32::MAX;

impl Bricks {
    pub(crate) fn new(side: f32, limit: u32) -> Self {
        Self { side, list: Vec::new(), table: vec![EMPTY; 1024], limit: limit as usize }
    }

    /// Coordinates of the brick that holds a point, `None` beyond a million bricks from the origin.
    pub(crate) fn key(&self, p: [f32; 3]) -> Option<[i32; 3]> {
        let k = p.map(|v| (v / self.side).floor());
        k.iter().all(|v| v.abs() < 1e6).then(|| k.map(|v| v as i32))
    }

    pub(crate) fn find(&self, key: [i32; 3]) -> Option<usize> {
        let mut i = self.home(key);
        loop {
            match self.table[i] {
                EMPTY => return None,
                n if self.list[n as usize].key == key => return Some(n as usize),
                _ => i = (i + 1) & (self.table.len() - 1),
            }
        }
    }

    /// The brick of `key`, made when absent; `None` when the map is full.
    pub(crate) fn find_or_make(&mut self, key: [i32; 3]) -> Option<usize> {
        if let Some(n) = self.find(key) {
            return Some(n);
        }
        if self.list.len() >= self.limit {
            return None;
        }
        if (self.list.len() + 1) * 2 > self.table.len() {
            self.grow();
        }
        let n = self.list.len();
        self.list.push(Brick { key, ..Brick::default() });
        self.enter(n);
        Some(n)
    }

    fn home(&self, key: [i32; 3]) -> usize {
        let mut h = 0u64;
        for k in key {
            h = (h ^ u64::from(k as u32)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            h ^= h >> 29;
        }
        h as usize & (self.table.len() - 1)
    }

    fn enter(&mut self, n: usize) {
        let mut i = self.home(self.list[n].key);
        while self.table[i] != EMPTY {
            i = (i + 1) & (self.table.len() - 1);
        }
        self.table[i] = n as u32;
    }

    fn grow(&mut self) {
        self.table = vec![EMPTY; self.table.len() * 2];
        for n in 0..self.list.len() {
            self.enter(n);
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.table.len() * 4
            + self.list.capacity() * size_of::<Brick>()
            + self.list.iter().map(|b| b.blocks.capacity() * size_of::<Block>()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_was_made_and_nothing_else() {
        let mut bricks = Bricks::new(0.25, 10_000);
        let keys: Vec<[i32; 3]> =
            (0..3000).map(|i: i32| [i % 13 - 6, (i / 13) % 17 - 8, i / 221 - 7]).collect();
        for (n, &k) in keys.iter().enumerate() {
            assert_eq!(bricks.find(k), None);
            assert_eq!(bricks.find_or_make(k), Some(n));
        }
        for (n, &k) in keys.iter().enumerate() {
            assert_eq!(bricks.find(k), Some(n));
        }
        assert_eq!(bricks.find([100, 0, 0]), None);
        let mut small = Bricks::new(0.25, 1);
        assert_eq!(small.find_or_make([0; 3]), Some(0));
        assert_eq!(small.find_or_make([1, 0, 0]), None);
        assert_eq!(small.key([f32::NAN, 0.0, 0.0]), None);
    }
}
