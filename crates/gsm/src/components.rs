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
    let (edge, links, parent) = (&frame.edge[..], &frame.links[..], &mut frame.parent[..]);
    for y in 0..frame.height {
        // Whether the pixel to the left is a linked non-edge pixel.
        let mut left = false;
        for i in y * w..(y + 1) * w {
            let open = edge[i] == 0;
            if open {
                if left {
                    parent[i] = parent[i - 1];
                }
                if y > 0 && edge[i - w] == 0 && links[i - w] & DOWN != 0 {
                    let a = root(parent, parent[i]);
                    let b = root(parent, parent[i - w]);
                    parent[a.max(b) as usize] = a.min(b);
                    parent[i] = a.min(b);
                }
            }
            left = open && links[i] & RIGHT != 0;
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
    let w = frame.width;
    let n = w * frame.height;
    frame.queue.clear();
    let (links, smooth) = (&frame.links[..], &frame.smooth[..]);
    let (label, size) = (&mut frame.label[..], &mut frame.region_size[..]);
    // Seeds: labelled pixels next to a linked bare one.
    for i in 0..n {
        let own = label[i] != 0;
        for (bit, step) in [(RIGHT, 1), (DOWN, w)] {
            if links[i] & bit != 0 && (label[i + step] != 0) != own {
                frame.queue.push(if own { i } else { i + step } as u32);
            }
        }
    }
    frame.queue.sort_unstable();
    let mut next = 0;
    while next < frame.queue.len() {
        let i = frame.queue[next] as usize;
        next += 1;
        let own = label[i];
        let mut reach = |j: usize| {
            if label[j] == 0 && smooth[j] > 0.0 {
                label[j] = own;
                size[own as usize] += 1;
                size[0] -= 1;
                frame.queue.push(j as u32);
            }
        };
        // A link bit is never set towards the outside of the image.
        if i >= w && links[i - w] & DOWN != 0 {
            reach(i - w);
        }
        if i > 0 && links[i - 1] & RIGHT != 0 {
            reach(i - 1);
        }
        if links[i] & RIGHT != 0 {
            reach(i + 1);
        }
        if links[i] & DOWN != 0 {
            reach(i + w);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Labels by flood fill, growth not included: the same numbering by another algorithm.
    fn flood(frame: &Frame, min: u32) -> Vec<u32> {
        let (w, n) = (frame.width, frame.edge.len());
        let mut label = vec![0; n];
        let mut next = 0;
        let mut done = vec![false; n];
        for start in 0..n {
            if done[start] || frame.edge[start] != 0 {
                continue;
            }
            let (mut stack, mut part) = (vec![start], vec![]);
            done[start] = true;
            while let Some(i) = stack.pop() {
                part.push(i);
                let mut around = vec![];
                if frame.links[i] & RIGHT != 0 {
                    around.push(i + 1);
                }
                if frame.links[i] & DOWN != 0 {
                    around.push(i + w);
                }
                if i >= 1 && frame.links[i - 1] & RIGHT != 0 {
                    around.push(i - 1);
                }
                if i >= w && frame.links[i - w] & DOWN != 0 {
                    around.push(i - w);
                }
                for j in around {
                    if !done[j] && frame.edge[j] == 0 {
                        done[j] = true;
                        stack.push(j);
                    }
                }
            }
            if part.len() as u32 >= min {
                next += 1;
                part.iter().for_each(|&i| label[i] = next);
            }
        }
        label
    }

    proptest! {
        #[test]
        fn components_equal_a_flood_fill(
            w in 1usize..24, h in 1usize..24, min in 1u32..6, bits in prop::collection::vec(0u8..16, 576),
        ) {
            let n = w * h;
            let mut frame = Frame { width: w, height: h, ..Frame::default() };
            frame.edge = bits[..n].iter().map(|b| u8::from(b & 12 == 12)).collect();
            frame.links = (0..n)
                .map(|i| {
                    let right = if i % w + 1 < w && bits[i] & 3 != 0 { RIGHT } else { 0 };
                    right | if i + w < n && bits[i] & 5 != 0 { DOWN } else { 0 }
                })
                .collect();
            frame.label = vec![0; n];
            frame.smooth = vec![1.0; n];
            unite(&mut frame);
            number(&mut frame, min);
            prop_assert_eq!(&frame.label, &flood(&frame, min));
            let before = frame.label.clone();
            grow(&mut frame);
            let mut sizes = vec![0; frame.region_size.len()];
            for (i, &l) in frame.label.iter().enumerate() {
                prop_assert!(before[i] == 0 || before[i] == l);
                sizes[l as usize] += 1;
            }
            prop_assert_eq!(&sizes, &frame.region_size);
        }
    }
}
