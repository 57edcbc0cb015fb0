//! The keys of a control center: one root key for each drone, and whatever is made of chance afterwards.

pub mod file;

use rand_chacha::ChaCha20Rng;
use rand_core::{Rng, SeedableRng};
use skyroost_protocol::{
    key::{KEY_LEN, Key},
    units::DroneId,
};

/// What seals the links of a control center.
#[derive(Clone)]
pub struct LinkKeys {
    /// By drone, from drone 1; empty where nothing is sealed.
    roots: Vec<Key>,
    /// Boots of the control center so far, from 1.
    boot_epoch: u16,
    /// What fresh keys come from, in each boot others.
    seed: Key,
    chance: ChaCha20Rng,
}

impl LinkKeys {
    /// Root keys by drone, from drone 1, and the control center's own. `boot_epoch` must rise with every start of a control center
    /// with these keys, from 1 on: what is fresh follows from `seed` and the boot, so that a [journal](super::journal) can be told again
    /// without holding a key.
    #[must_use]
    pub fn new(roots: Vec<Key>, boot_epoch: u16, seed: &Key) -> Self {
        let mut chance = ChaCha20Rng::from_seed(*seed.expose());
        chance.set_stream(u64::from(boot_epoch));
        Self { roots, boot_epoch, seed: seed.clone(), chance }
    }

    /// The same at another boot.
    #[must_use]
    pub fn at_boot(&self, boot_epoch: u16) -> Self {
        Self::new(self.roots.clone(), boot_epoch, &self.seed)
    }

    /// Nothing is sealed.
    #[must_use]
    pub fn none() -> Self {
        Self::new(Vec::new(), 1, &Key::new([0; KEY_LEN]))
    }

    /// Whether links are sealed.
    #[must_use]
    pub fn is_sealed(&self) -> bool {
        !self.roots.is_empty()
    }

    /// Boots of the control center so far.
    #[must_use]
    pub fn boot_epoch(&self) -> u16 {
        self.boot_epoch
    }

    /// The root key of a drone; none where nothing is sealed.
    ///
    /// # Panics
    /// Where links are sealed and the drone has no key: keys are counted against drones when they are read.
    #[must_use]
    pub fn root(&self, drone: DroneId) -> Option<&Key> {
        let root = self.roots.get(usize::from(drone.0) - 1);
        assert!(root.is_some() || !self.is_sealed(), "drone {} has no key", drone.0);
        root
    }

    /// A key that nobody has had.
    pub fn fresh(&mut self) -> Key {
        let mut bytes = [0; KEY_LEN];
        self.chance.fill_bytes(&mut bytes);
        Key::new(bytes)
    }
}

impl std::fmt::Debug for LinkKeys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { roots, boot_epoch, .. } = self;
        write!(f, "LinkKeys({} keys, boot epoch {boot_epoch})", roots.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_fresh_and_not_printed() {
        let mut keys = LinkKeys::new(vec![Key::new([7; KEY_LEN])], 3, &Key::new([9; KEY_LEN]));
        assert_ne!(keys.fresh(), keys.fresh());
        assert_eq!(format!("{keys:?}"), "LinkKeys(1 keys, boot epoch 3)");
        assert!(keys.is_sealed() && !LinkKeys::none().is_sealed());
        assert_eq!(keys.root(DroneId(1)), Some(&Key::new([7; KEY_LEN])));
        assert_eq!(LinkKeys::none().root(DroneId(1)), None);
    }
}
