//! Names of users and drones: each kept once, and sorted as people count.

use std::cmp::Ordering;
use std::collections::HashMap;

/// Names in the order in which they first appeared.
#[derive(Default)]
pub(super) struct Labels {
    index: HashMap<String, u32>,
}

impl Labels {
    /// The number of a name, from 0; a new name gets the next one.
    pub(super) fn number(&mut self, name: &str) -> u32 {
        if let Some(&number) = self.index.get(name) {
            return number;
        }
        let number = self.index.len() as u32;
        self.index.insert(name.to_owned(), number);
        number
    }

    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    /// The names in their natural order, and the rank there of every number.
    pub(super) fn sorted(self) -> (Vec<String>, Vec<u32>) {
        let mut names: Vec<(String, u32)> = self.index.into_iter().collect();
        names.sort_unstable_by(|a, b| natural(&a.0, &b.0));
        let mut rank = vec![0; names.len()];
        for (place, (_, number)) in (0..).zip(&names) {
            rank[*number as usize] = place;
        }
        (names.into_iter().map(|(name, _)| name).collect(), rank)
    }
}

/// The order in which `u2` stands before `u10`: runs of digits count as numbers, all else byte by byte.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let ([p, after_p @ ..], [q, after_q @ ..]) = (x, y) {
        if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, n);
            ((m, x), (n, y)) = (leading_number(x), leading_number(y));
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
            if order.is_ne() {
                return order;
            }
        } else if p == q {
            (x, y) = (after_p, after_q);
        } else {
            return p.cmp(q);
        }
    }
    // `01` and `1` are the same number and not the same name.
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// The digits that a text starts with, without leading zeros, and what follows them.
fn leading_number(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len());
    let zeros = text[..end].iter().take_while(|&&b| b == b'0').count();
    (&text[zeros..end], &text[end..])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_in_names_count() {
        let sorted = ["", "1", "01", "2", "10", "a", "u1", "u2", "u2a", "u2b3", "u2b20", "u10", "v"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                // Of the names of one number the longer one is first.
                let expected = if (i, j) == (1, 2) || (i, j) == (2, 1) { j.cmp(&i) } else { i.cmp(&j) };
                assert_eq!(natural(a, b), expected, "{a} {b}");
            }
        }
    }

    proptest! {
        #[test]
        fn is_a_total_order(a in "[a0-2]{0,5}", b in "[a0-2]{0,5}", c in "[a0-2]{0,5}") {
            prop_assert_eq!(natural(&a, &b), natural(&b, &a).reverse());
            prop_assert_eq!(natural(&a, &b) == Ordering::Equal, a == b);
            if natural(&a, &b).is_le() && natural(&b, &c).is_le() {
                prop_assert!(natural(&a, &c).is_le());
            }
        }
    }
}
