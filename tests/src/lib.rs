//! Whole-mission tests live in `tests/tests/`.
