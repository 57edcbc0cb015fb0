//! How values become bytes.
//!
//! Integers are little-endian and of fixed width, an enum is a tag byte and the fields of the variant,
//! an [`Option`] a byte 0 or 1 and the value, a bounded vector a count byte and its elements, a struct
//! its fields in order, with nothing in between. So every value has exactly one encoding, a frame's
//! length does not depend on where the drones fly, and the longest encoding of every type is a
//! constant.
//!
//! [`Wire`] is implemented by listing a type's fields with `wire_struct!`, `wire_enum!` or
//! `wire_newtype!`; the compiler refuses a list that does not match the type.

use heapless::Vec;

/// The output buffer is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Full;

/// The bytes are not an encoding of the value asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed;

/// A value with a fixed encoding.
pub trait Wire: Sized {
    /// Bytes of the longest encoding.
    const MAX_LEN: usize;

    /// Hash over names, order and types of everything within, for
    /// [`SCHEMA_HASH`](crate::SCHEMA_HASH).
    const SHAPE: u32;

    /// Appends the encoding.
    ///
    /// # Errors
    /// [`Full`] where the buffer ends before the value does.
    fn write(&self, out: &mut Writer<'_>) -> Result<(), Full>;

    /// Takes the encoding off the input. Inlined by force throughout: a message is built where it stays,
    /// field by field, which halves the time to decode one.
    ///
    /// # Errors
    /// [`Malformed`] where the input ends early or holds a tag or count that does not exist.
    fn read(input: &mut Reader<'_>) -> Result<Self, Malformed>;
}

/// Fills a buffer from its start.
#[derive(Debug)]
pub struct Writer<'a> {
    free: &'a mut [u8],
}

impl<'a> Writer<'a> {
    /// An empty writer over the buffer.
    pub const fn new(buffer: &'a mut [u8]) -> Self {
        Self { free: buffer }
    }

    /// Bytes still free.
    #[must_use]
    pub const fn remaining(&self) -> usize {
        self.free.len()
    }

    /// Appends `bytes`.
    ///
    /// # Errors
    /// [`Full`] where they do not fit; nothing is written then.
    #[inline]
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) -> Result<(), Full> {
        if self.free.len() < N {
            return Err(Full);
        }
        let (head, rest) = core::mem::take(&mut self.free).split_first_chunk_mut::<N>().ok_or(Full)?;
        *head = bytes;
        self.free = rest;
        Ok(())
    }
}

/// Takes bytes off the start of a slice.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// A reader over all of `bytes`.
    #[must_use]
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// Whether every byte was taken.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Takes `N` bytes.
    ///
    /// # Errors
    /// [`Malformed`] where fewer are left.
    #[inline]
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let (head, rest) = self.rest.split_first_chunk::<N>().ok_or(Malformed)?;
        self.rest = rest;
        Ok(*head)
    }
}

macro_rules! wire_integers {
    ($($int:ident),*) => {$(
        impl Wire for $int {
            const MAX_LEN: usize = size_of::<Self>();
            const SHAPE: u32 = shape_of(stringify!($int));

            #[inline]
            fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
                out.put(self.to_le_bytes())
            }

            #[inline(always)]
            fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
                Ok(Self::from_le_bytes(input.take()?))
            }
        }
    )*};
}

wire_integers!(u8, u16, u32, i16, i32, i64);

impl<T: Wire + Copy, const N: usize> Wire for [T; N] {
    const MAX_LEN: usize = N * T::MAX_LEN;
    const SHAPE: u32 = with_part(with_number(shape_of("array"), N), "element", T::SHAPE);

    #[inline]
    fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
        self.iter().try_for_each(|element| element.write(out))
    }

    #[inline(always)]
    fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
        const { assert!(N > 0, "the first element fills the array before the others are read") }
        let mut array = [T::read(input)?; N];
        if let Some((_, others)) = array.split_first_mut() {
            for element in others {
                *element = T::read(input)?;
            }
        }
        Ok(array)
    }
}

impl<T: Wire> Wire for Option<T> {
    const MAX_LEN: usize = 1 + T::MAX_LEN;
    const SHAPE: u32 = with_part(shape_of("option"), "some", T::SHAPE);

    #[inline]
    fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
        match self {
            None => out.put([0]),
            Some(value) => {
                out.put([1])?;
                value.write(out)
            }
        }
    }

    #[inline(always)]
    fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
        match input.take()? {
            [0] => Ok(None),
            [1] => T::read(input).map(Some),
            _ => Err(Malformed),
        }
    }
}

impl<T: Wire, const N: usize> Wire for Vec<T, N> {
    const MAX_LEN: usize = 1 + N * T::MAX_LEN;
    const SHAPE: u32 = with_part(with_number(shape_of("vec"), N), "element", T::SHAPE);

    #[inline]
    fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
        const { assert!(N <= u8::MAX as usize, "the count is one byte") }
        out.put([self.len() as u8])?;
        self.iter().try_for_each(|element| element.write(out))
    }

    #[inline(always)]
    fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
        let [count] = input.take()?;
        let mut vec = Self::new();
        for _ in 0..count {
            // A count beyond the capacity ends here, after at most `N` elements.
            vec.push(T::read(input)?).map_err(|_| Malformed)?;
        }
        Ok(vec)
    }
}

/// Implements [`Wire`] for a tuple struct of one integer or array.
macro_rules! wire_newtype {
    ($($name:ident($inner:ty);)*) => {$(
        impl Wire for $name {
            const MAX_LEN: usize = <$inner as Wire>::MAX_LEN;
            const SHAPE: u32 = with_part(shape_of(stringify!($name)), "0", <$inner as Wire>::SHAPE);

            #[inline]
            fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
                <$inner as Wire>::write(&self.0, out)
            }

            #[inline(always)]
            fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
                <$inner as Wire>::read(input).map(Self)
            }
        }
    )*};
}

/// Implements [`Wire`] for a struct by its fields in the order of the wire.
macro_rules! wire_struct {
    ($name:ident { $($field:ident: $ty:ty),+ $(,)? }) => {
        impl Wire for $name {
            const MAX_LEN: usize = 0 $(+ <$ty as Wire>::MAX_LEN)+;
            const SHAPE: u32 = {
                let shape = shape_of(stringify!($name));
                $(let shape = with_part(shape, stringify!($field), <$ty as Wire>::SHAPE);)+
                shape
            };

            #[inline]
            fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
                let Self { $($field),+ } = self;
                $(<$ty as Wire>::write($field, out)?;)+
                Ok(())
            }

            #[inline(always)]
            fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
                $(let $field = <$ty as Wire>::read(input)?;)+
                Ok(Self { $($field),+ })
            }
        }
    };
}

/// Implements [`Wire`] for an enum by tag, variant and the variant's fields in the order of the wire.
macro_rules! wire_enum {
    ($name:ident {
        $($tag:literal = $variant:ident
            $(($bind:ident: $inner:ty))?
            $({ $($field:ident: $ty:ty),+ $(,)? })?
        ),+ $(,)?
    }) => {
        impl Wire for $name {
            const MAX_LEN: usize = 1 + longest(&[
                $(0 $(+ <$inner as Wire>::MAX_LEN)? $($(+ <$ty as Wire>::MAX_LEN)+)?),+
            ]);
            const SHAPE: u32 = {
                let shape = shape_of(stringify!($name));
                $(
                    let shape = with_part(shape, stringify!($variant), $tag);
                    $(let shape = with_part(shape, stringify!($bind), <$inner as Wire>::SHAPE);)?
                    $($(let shape = with_part(shape, stringify!($field), <$ty as Wire>::SHAPE);)+)?
                )+
                shape
            };

            #[inline]
            fn write(&self, out: &mut Writer<'_>) -> Result<(), Full> {
                match self {
                    $(Self::$variant $(($bind))? $({ $($field),+ })? => {
                        out.put([$tag])?;
                        $(<$inner as Wire>::write($bind, out)?;)?
                        $($(<$ty as Wire>::write($field, out)?;)+)?
                    })+
                }
                Ok(())
            }

            #[inline(always)]
            fn read(input: &mut Reader<'_>) -> Result<Self, Malformed> {
                match input.take()? {
                    $([$tag] => {
                        $(let $bind = <$inner as Wire>::read(input)?;)?
                        $($(let $field = <$ty as Wire>::read(input)?;)+)?
                        Ok(Self::$variant $(($bind))? $({ $($field),+ })?)
                    })+
                    _ => Err(Malformed),
                }
            }
        }
    };
}

pub(crate) use {wire_enum, wire_newtype, wire_struct};

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
