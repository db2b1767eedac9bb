//! A decision tree on box sizes alone: how much of the classes do sizes give away?

/// Number of features: width and depth of the axis-aligned box (larger first), height, height of
/// the centre above the floor.
pub const FEATURES: usize = 4;

/// A classification tree (CART, Gini impurity).
#[derive(Clone, Debug)]
pub enum Tree {
    /// The class.
    Leaf(usize),
    /// Feature, threshold, at most the threshold, above it.
    Node(usize, f32, Box<Tree>, Box<Tree>),
}

/// Fewer samples than this are not split.
const SMALLEST: usize = 8;

impl Tree {
    /// Grows a tree of at most `depth` questions.
    #[must_use]
    pub fn grow(samples: &[([f32; FEATURES], usize)], classes: usize, depth: usize) -> Self {
        let mut counts = vec![0_usize; classes];
        for s in samples {
            counts[s.1] += 1;
        }
        let best = (0..classes).max_by_key(|&c| (counts[c], classes - c)).unwrap_or(0);
        if depth == 0 || samples.len() < SMALLEST || counts[best] == samples.len() {
            return Self::Leaf(best);
        }
        let Some((feature, threshold)) = cut(samples, &counts) else { return Self::Leaf(best) };
        let (low, high): (Vec<_>, Vec<_>) = samples.iter().partition(|s| s.0[feature] <= threshold);
        Self::Node(
            feature,
            threshold,
            Box::new(Self::grow(&low, classes, depth - 1)),
            Box::new(Self::grow(&high, classes, depth - 1)),
        )
    }

    /// The class of a box.
    #[must_use]
    pub fn classify(&self, x: &[f32; FEATURES]) -> usize {
        match self {
            Self::Leaf(c) => *c,
            Self::Node(f, t, low, high) => if x[*f] <= *t { low } else { high }.classify(x),
        }
    }
}

/// The cut with the purest two sides.
fn cut(samples: &[([f32; FEATURES], usize)], total: &[usize]) -> Option<(usize, f32)> {
    let square = |n: usize| (n * n) as f64;
    let mut best: Option<(f64, usize, f32)> = None;
    for feature in 0..FEATURES {
        let mut order: Vec<(f32, usize)> = samples.iter().map(|s| (s.0[feature], s.1)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut low = vec![0_usize; total.len()];
        let mut high = total.to_vec();
        let (mut sum_low, mut sum_high) = (0.0, high.iter().map(|&n| square(n)).sum::<f64>());
        for i in 0..order.len() - 1 {
            let c = order[i].1;
            sum_low += 2.0 * low[c] as f64 + 1.0;
            sum_high -= 2.0 * high[c] as f64 - 1.0;
            low[c] += 1;
            high[c] -= 1;
            if order[i].0 < order[i + 1].0 {
                let n = (i + 1) as f64;
                // The larger the sum, the smaller the weighted Gini impurity.
                let purity = sum_low / n + sum_high / (order.len() as f64 - n);
                if best.is_none_or(|b| purity > b.0 + 1e-9) {
                    best = Some((purity, feature, f32::midpoint(order[i].0, order[i + 1].0)));
                }
            }
        }
    }
    best.map(|b| (b.1, b.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_a_checkerboard() {
        let samples: Vec<([f32; FEATURES], usize)> = (0..400)
            .map(|k| {
                let (x, y) = ((k % 20) as f32 / 20.0, (k / 20) as f32 / 20.0);
                ([x, y, 0.0, 0.0], usize::from((x > 0.48) == (y > 0.22)))
            })
            .collect();
        let tree = Tree::grow(&samples, 2, 3);
        assert!(samples.iter().all(|s| tree.classify(&s.0) == s.1));
    }
}
