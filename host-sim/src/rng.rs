//! Seeds split per (seed, stream, index).
