//! A bounded table whose entries stay where they are.

/// Up to `N` entries, 255 at most, in order of age. What moves as entries come and go are their numbers, a byte
/// each: an entry itself is written once.
#[derive(Clone, Debug)]
pub struct Slots<T, const N: usize> {
    places: [T; N],
    /// Every place once: those in use, by age, then those that are free.
    order: [u8; N],
    used: usize,
}

impl<T: Copy, const N: usize> Slots<T, N> {
    /// An empty table; `unused` is what fills its places.
    #[must_use]
    pub const fn new(unused: T) -> Self {
        const { assert!(N <= u8::MAX as usize, "places have numbers of a byte") };
        let mut order = [0; N];
        let (mut rest, mut number) = (order.as_mut_slice(), 0_u8);
        while let Some((first, others)) = rest.split_first_mut() {
            *first = number;
            (rest, number) = (others, number.saturating_add(1));
        }
        Self { places: [unused; N], order, used: 0 }
    }

    /// Forgets all entries.
    pub const fn clear(&mut self) {
        self.used = 0;
    }

    /// Entries there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.used
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.used == 0
    }

    /// Whether there is room for no more.
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.used >= N
    }

    /// The youngest entry from now on; none when the table is full.
    pub fn push(&mut self, entry: T) -> Option<&mut T> {
        let place = self.order.get(self.used)?;
        let place = self.places.get_mut(usize::from(*place))?;
        *place = entry;
        self.used += 1;
        Some(place)
    }

    /// The entry of this age, the oldest being 0.
    pub fn get_mut(&mut self, age: usize) -> Option<&mut T> {
        let place = self.order.get(..self.used)?.get(age)?;
        self.places.get_mut(usize::from(*place))
    }

    /// Age of the oldest entry of which this holds.
    #[must_use]
    pub fn position(&self, mut holds: impl FnMut(&T) -> bool) -> Option<usize> {
        let used = self.order.get(..self.used)?;
        used.iter().position(|place| self.places.get(usize::from(*place)).is_some_and(&mut holds))
    }

    /// Forgets the entry of this age, if there is one.
    pub fn remove(&mut self, age: usize) {
        if age < self.used {
            self.used -= 1;
            for pair in age..self.used {
                self.swap(pair, pair + 1);
            }
        }
    }

    /// Looks at every entry, the oldest first, and forgets those for which `keep` says so.
    pub fn retain_mut(&mut self, mut keep: impl FnMut(&mut T) -> bool) {
        let mut kept = 0;
        for age in 0..self.used {
            if self.get_mut(age).is_some_and(&mut keep) {
                self.swap(kept, age);
                kept += 1;
            }
        }
        self.used = kept;
    }

    /// Swaps two numbers; `slice::swap` would panic beyond the end.
    fn swap(&mut self, one: usize, other: usize) {
        if let (Some(&a), Some(&b)) = (self.order.get(one), self.order.get(other)) {
            if let Some(place) = self.order.get_mut(one) {
                *place = b;
            }
            if let Some(place) = self.order.get_mut(other) {
                *place = a;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};

    const ROOM: usize = 5;

    fn entries(table: &mut Slots<u16, ROOM>) -> Vec<u16> {
        (0..table.len()).map(|age| *table.get_mut(age).expect("as many as it says")).collect()
    }

    #[derive(Clone, Debug)]
    enum Deed {
        Push(u16),
        Remove(usize),
        /// Keeps those that this does not divide.
        Retain(u16),
        Clear,
    }

    fn deed() -> impl Strategy<Value = Deed> {
        prop_oneof![
            6 => (0..100_u16).prop_map(Deed::Push),
            3 => (0..ROOM + 2).prop_map(Deed::Remove),
            2 => (2..5_u16).prop_map(Deed::Retain),
            1 => Just(Deed::Clear),
        ]
    }

    proptest! {
        /// Whatever happens, it holds what a vector would.
        #[test]
        fn truth_is_a_vector(deeds in vec(deed(), 0..200)) {
            let (mut table, mut model) = (Slots::<u16, ROOM>::new(0), Vec::new());
            for deed in deeds {
                match deed {
                    Deed::Push(entry) if model.len() < ROOM => {
                        prop_assert_eq!(table.push(entry).copied(), Some(entry));
                        model.push(entry);
                    }
                    Deed::Push(entry) => prop_assert!(table.is_full() && table.push(entry).is_none()),
                    Deed::Remove(age) => {
                        table.remove(age);
                        if age < model.len() {
                            model.remove(age);
                        }
                    }
                    Deed::Retain(divisor) => {
                        let mut seen = Vec::new();
                        table.retain_mut(|entry| {
                            seen.push(*entry);
                            *entry % divisor != 0
                        });
                        prop_assert_eq!(&seen, &model, "every entry once, by age");
                        model.retain(|entry| entry % divisor != 0);
                    }
                    Deed::Clear => {
                        table.clear();
                        model.clear();
                    }
                }
                prop_assert_eq!(entries(&mut table), model.clone());
                prop_assert_eq!((table.is_empty(), table.is_full()), (model.is_empty(), model.len() == ROOM));
                for entry in &model {
                    let found = table.position(|known| known == entry);
                    prop_assert_eq!(found, model.iter().position(|known| known == entry));
                }
            }
        }
    }
}
