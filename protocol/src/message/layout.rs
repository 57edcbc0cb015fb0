//! What the compiler knows of every type on the wire: how long it can get, and a hash of its shape.
//!
//! A body is [postcard](https://postcard.jamesmunns.com/wire-format): `u8` is a byte, wider integers are
//! varints of 7 bits a byte, the lowest first (signed ones zigzag before), an enum is the number of its
//! variant and the variant's fields, an [`Option`] a byte 0 or 1 and the value, a vector its length and
//! its elements, an array its elements, a struct its fields in order.
//!
//! Types with more than one part are defined within [`wire!`], so that what is said here of a type cannot
//! differ from what serde derives from the same definition.

use super::{Down, Manner, Peer, TdoaFlags, Up};
use crate::key::{KEY_LEN, Key};
use crate::units::{
    CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
    VelEnuMmps,
};
use heapless::Vec;

/// Hash over the shapes of all messages: both ends of a link compare it before anything else, because
/// equal hashes mean equal variants, fields, types and capacities.
pub const SCHEMA_HASH: u32 = {
    let shape = shape_of("skyroost in postcard 1");
    let shape = with_part(shape, "up", Up::SHAPE);
    let shape = with_part(shape, "down", Down::SHAPE);
    with_part(shape, "peer", Peer::SHAPE)
};

/// A type that can stand on the wire.
pub(crate) trait Layout {
    /// Bytes of the longest encoding.
    const MAX_LEN: usize;
    /// Hash over names, order and types of everything within.
    const SHAPE: u32;
}

impl Layout for u8 {
    const MAX_LEN: usize = 1;
    const SHAPE: u32 = shape_of("u8");
}

impl Layout for bool {
    const MAX_LEN: usize = 1;
    const SHAPE: u32 = shape_of("bool");
}

impl Layout for Key {
    const MAX_LEN: usize = KEY_LEN;
    const SHAPE: u32 = shape_of("Key");
}

macro_rules! varints {
    ($($int:ident),*) => {$(
        impl Layout for $int {
            const MAX_LEN: usize = ($int::BITS as usize).div_ceil(7);
            const SHAPE: u32 = shape_of(stringify!($int));
        }
    )*};
}

varints!(u16, u32, u64, i16, i32, i64);

impl<T: Layout, const N: usize> Layout for [T; N] {
    const MAX_LEN: usize = N * T::MAX_LEN;
    const SHAPE: u32 = with_part(with_number(shape_of("array"), N), "element", T::SHAPE);
}

impl<T: Layout> Layout for Option<T> {
    const MAX_LEN: usize = 1 + T::MAX_LEN;
    const SHAPE: u32 = with_part(shape_of("option"), "some", T::SHAPE);
}

impl<T: Layout, const N: usize> Layout for Vec<T, N> {
    const MAX_LEN: usize = {
        assert!(N < 128, "the length is one byte of varint");
        1 + N * T::MAX_LEN
    };
    const SHAPE: u32 = with_part(with_number(shape_of("vec"), N), "element", T::SHAPE);
}

/// Implements [`Layout`] for units, which postcard writes as what they hold. The compiler refuses a type
/// that does not hold just that.
macro_rules! units {
    ($($name:ident($inner:ty);)*) => {$(
        impl Layout for $name {
            const MAX_LEN: usize = {
                let _: fn($inner) -> Self = Self;
                <$inner as Layout>::MAX_LEN
            };
            const SHAPE: u32 = with_part(shape_of(stringify!($name)), "0", <$inner as Layout>::SHAPE);
        }
    )*};
}

units! {
    DroneId(u16);
    FleetId(u16);
    UserId(u32);
    OccasionId(u32);
    CommandId(u16);
    MissionId(u16);
    TimePs(i64);
    TdoaPs(i32);
    ToaSigma(u16);
    PosEnuMm([i32; 3]);
    VelEnuMmps([i16; 3]);
    TdoaFlags(u8);
    Manner(u8);
}

/// Defines the structs and enums within and implements [`Layout`] for them.
macro_rules! wire {
    () => {};
    (
        $(#[$attribute:meta])*
        pub struct $name:ident {
            $($(#[$field_attribute:meta])* pub $field:ident: $ty:ty,)+
        }
        $($rest:tt)*
    ) => {
        $(#[$attribute])*
        pub struct $name {
            $($(#[$field_attribute])* pub $field: $ty,)+
        }

        impl $crate::message::layout::Layout for $name {
            const MAX_LEN: usize = 0 $(+ <$ty as $crate::message::layout::Layout>::MAX_LEN)+;
            const SHAPE: u32 = {
                use $crate::message::layout::{shape_of, with_part};
                let shape = shape_of(stringify!($name));
                $(let shape = with_part(shape, stringify!($field), <$ty as $crate::message::layout::Layout>::SHAPE);)+
                shape
            };
        }

        $crate::message::layout::wire! { $($rest)* }
    };
    (
        $(#[$attribute:meta])*
        pub enum $name:ident {
            $(
                $(#[$variant_attribute:meta])*
                $variant:ident
                $(($inner:ty))?
                $({ $($(#[$field_attribute:meta])* $field:ident: $ty:ty,)+ })?
            ,)+
        }
        $($rest:tt)*
    ) => {
        $(#[$attribute])*
        pub enum $name {
            $(
                $(#[$variant_attribute])*
                $variant
                $(($inner))?
                $({ $($(#[$field_attribute])* $field: $ty,)+ })?
            ,)+
        }

        impl $crate::message::layout::Layout for $name {
            const MAX_LEN: usize = {
                use $crate::message::layout::longest;
                let variants = [
                    $(0 $(+ <$inner as $crate::message::layout::Layout>::MAX_LEN)? $($(+ <$ty as $crate::message::layout::Layout>::MAX_LEN)+)?),+
                ];
                assert!(variants.len() < 128, "the number of the variant is one byte of varint");
                1 + longest(&variants)
            };
            const SHAPE: u32 = {
                use $crate::message::layout::{shape_of, with_part};
                let shape = shape_of(stringify!($name));
                $(
                    let shape = with_part(shape, stringify!($variant), shape_of("variant"));
                    $(let shape = with_part(shape, "0", <$inner as $crate::message::layout::Layout>::SHAPE);)?
                    $($(let shape = with_part(shape, stringify!($field), <$ty as $crate::message::layout::Layout>::SHAPE);)+)?
                )+
                shape
            };
        }

        $crate::message::layout::wire! { $($rest)* }
    };
}

pub(crate) use wire;

/// The largest of the lengths, at compile time.
pub(crate) const fn longest(lengths: &[usize]) -> usize {
    let mut max = 0;
    let mut i = 0;
    while i < lengths.len() {
        if lengths[i] > max {
            max = lengths[i];
        }
        i += 1;
    }
    max
}

/// 32-bit FNV-1a, which needs no table at compile time.
const fn fnv1a(mut hash: u32, bytes: &[u8]) -> u32 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// Shape of a type without parts.
pub(crate) const fn shape_of(name: &str) -> u32 {
    fnv1a(0x811c_9dc5, name.as_bytes())
}

/// `shape` continued by a named part.
pub(crate) const fn with_part(shape: u32, name: &str, part: u32) -> u32 {
    // The zero keeps the end of the name apart from what follows.
    fnv1a(fnv1a(fnv1a(shape, name.as_bytes()), &[0]), &part.to_le_bytes())
}

/// `shape` continued by a number, such as a capacity.
const fn with_number(shape: u32, number: usize) -> u32 {
    fnv1a(shape, &(number as u32).to_le_bytes())
}
