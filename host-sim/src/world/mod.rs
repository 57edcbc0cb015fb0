//! The simulated world: vehicles, air, clocks, radio and users.
