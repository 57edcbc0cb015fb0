//! Flight code.
#![no_std]
