//! What a best-first search looks at next.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Items by falling ceiling, the older of two equals first.
#[derive(Debug)]
pub(super) struct Queue<T> {
    heap: BinaryHeap<Entry<T>>,
    pushed: u64,
}

#[derive(Debug)]
struct Entry<T> {
    ceiling: f64,
    age: u64,
    item: T,
}

impl<T> Queue<T> {
    pub(super) fn push(&mut self, ceiling: f64, item: T) {
        self.heap.push(Entry { ceiling, age: self.pushed, item });
        self.pushed += 1;
    }

    /// The item with the highest ceiling, and that.
    pub(super) fn pop(&mut self) -> Option<(f64, T)> {
        self.heap.pop().map(|entry| (entry.ceiling, entry.item))
    }

    /// The highest ceiling; minus infinity where nothing is left.
    pub(super) fn ceiling(&self) -> f64 {
        self.heap.peek().map_or(f64::NEG_INFINITY, |entry| entry.ceiling)
    }
}

impl<T> Default for Queue<T> {
    fn default() -> Self {
        Self { heap: BinaryHeap::new(), pushed: 0 }
    }
}

impl<T> FromIterator<(f64, T)> for Queue<T> {
    fn from_iter<I: IntoIterator<Item = (f64, T)>>(items: I) -> Self {
        let entries = (0..).zip(items).map(|(age, (ceiling, item))| Entry { ceiling, age, item });
        let heap: BinaryHeap<Entry<T>> = entries.collect();
        Self { pushed: heap.len() as u64, heap }
    }
}

impl<T> Ord for Entry<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.ceiling.total_cmp(&other.ceiling).then(other.age.cmp(&self.age))
    }
}
impl<T> PartialOrd for Entry<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<T> PartialEq for Entry<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl<T> Eq for Entry<T> {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_ceiling_comes_first_and_the_older_of_equals() {
        let mut queue: Queue<char> = [(1.0, 'a'), (3.0, 'b'), (1.0, 'c')].into_iter().collect();
        queue.push(3.0, 'd');
        queue.push(2.0, 'e');
        assert!((queue.ceiling() - 3.0).abs() < f64::EPSILON);
        let order: String = std::iter::from_fn(|| queue.pop()).map(|(_, item)| item).collect();
        assert_eq!(order, "bdeac");
        assert!(queue.ceiling() < f64::MIN);
    }
}
