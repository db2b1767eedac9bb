//! Regions of a frame: connected pixels that are no edges, grown back into the edges between them.

use crate::Params;
use crate::frame::{DOWN, Frame, RIGHT};

/// Writes `label` and `region_size`: 4-connected components of non-edge pixels over unbroken links, numbered from 1
/// in raster order of their first pixel; components of fewer than `min_region_pixels` are dropped; then labels grow
/// over unbroken links into edge pixels, nearest first.
pub(crate) fn regions(frame: &mut Frame, params: &Params) {
    unite(frame);
    number(frame, params.min_region_pixels);
    grow(frame);
}

/// Root of `i`, halving the path.
fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        let up = parent[parent[i as usize] as usize];
        parent[i as usize] = up;
        i = up;
    }
    i
}

/// One raster pass: `parent` leads every non-edge pixel to the first pixel of its component.
fn unite(frame: &mut Frame) {
    let w = frame.width;
    frame.parent.clear();
    frame.parent.extend(0..(w * frame.height) as u32);
    for i in 0..w * frame.height {
        if frame.edge[i] != 0 {
            continue;
        }
        if i % w > 0 && frame.edge[i - 1] == 0 && frame.links[i - 1] & RIGHT != 0 {
            frame.parent[i] = frame.parent[i - 1];
        }
        if i >= w && frame.edge[i - w] == 0 && frame.links[i - w] & DOWN != 0 {
            let a = root(&mut frame.parent, i as u32);
            let b = root(&mut frame.parent, (i - w) as u32);
            let (low, high) = (a.min(b), a.max(b));
            frame.parent[high as usize] = low;
        }
    }
}

fn number(frame: &mut Frame, min_pixels: u32) {
    let n = frame.edge.len();
    frame.queue.clear();
    frame.queue.resize(n, 0);
    for i in 0..n {
        if frame.edge[i] == 0 {
            let r = root(&mut frame.parent, i as u32);
            frame.parent[i] = r;
            frame.queue[r as usize] += 1;
        }
    }
    frame.region_size.clear();
    frame.region_size.push(0);
    for i in 0..n {
        let own = if frame.edge[i] != 0 || frame.queue[frame.parent[i] as usize] < min_pixels {
            0
        } else if frame.parent[i] as usize == i {
            frame.region_size.push(0);
            frame.region_size.len() as u32 - 1
        } else {
            frame.label[frame.parent[i] as usize]
        };
        frame.label[i] = own;
        frame.region_size[own as usize] += 1;
    }
}

/// Breadth-first growth; a pixel takes the label that reaches it first, ties in raster order.
fn grow(frame: &mut Frame) {
    let (w, h) = (frame.width, frame.height);
    frame.queue.clear();
    for i in 0..w * h {
        if frame.label[i] != 0 && has_bare_neighbour(frame, i) {
            frame.queue.push(i as u32);
        }
    }
    let mut next = 0;
    while next < frame.queue.len() {
        let i = frame.queue[next] as usize;
        next += 1;
        let label = frame.label[i];
        for j in linked(frame, i).into_iter().flatten() {
            if frame.label[j] == 0 && frame.smooth[j] > 0.0 {
                frame.label[j] = label;
                frame.region_size[label as usize] += 1;
                frame.region_size[0] -= 1;
                frame.queue.push(j as u32);
            }
        }
    }
}

fn has_bare_neighbour(frame: &Frame, i: usize) -> bool {
    linked(frame, i).into_iter().flatten().any(|j| frame.label[j] == 0)
}

/// The four neighbours over unbroken links.
#[inline]
fn linked(frame: &Frame, i: usize) -> [Option<usize>; 4] {
    let w = frame.width;
    let link = |from: usize, bit: u8, to: usize| (frame.links[from] & bit != 0).then_some(to);
    [
        if i >= w { link(i - w, DOWN, i - w) } else { None },
        if !i.is_multiple_of(w) { link(i - 1, RIGHT, i - 1) } else { None },
        link(i, RIGHT, i + 1),
        link(i, DOWN, i + w),
    ]
}
