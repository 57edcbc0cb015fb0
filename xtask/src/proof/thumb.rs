//! What matters of a Thumb-2 instruction for stack and calls: how it moves the stack pointer, and where
//! it goes. Everything else is [`Op::Other`].
//!
//! Source of the encodings: ARMv7-M Architecture Reference Manual (DDI 0403), A5 and A7.7.

/// The stack pointer's number among the registers.
pub(super) const SP: u8 = 13;
const LR: u8 = 14;
pub(super) const PC: u8 = 15;

/// An instruction's effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Op {
    Other,
    /// The stack grows by so many bytes; shrinks if negative.
    Stack(i32),
    /// As [`Op::Stack`], and returns.
    Return(i32),
    /// The stack grows by what the register holds.
    StackByRegister(u8),
    /// The stack pointer is set to a register plus a number.
    StackFrom(u8, i32),
    /// The stack pointer is set in some other way.
    StackUnknown,
    /// Goes to an address; only under a condition if `true`.
    Branch(u32, bool),
    Call(u32),
    /// Calls the address in a register.
    CallRegister,
    /// Goes to an address that was calculated or loaded.
    Jump,
    /// Goes to one of the addresses in the table at what the register holds (the table that follows, for the program
    /// counter), of bytes or, if `true`, of halfwords.
    Table(u8, bool),
    /// The next so many instructions are conditional.
    IfThen(u8),
    /// Raises a fault: what a compiler puts where nothing should come.
    Trap,
    /// Puts something known into a register.
    Set(u8, Value),
}

/// What an instruction puts into a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Value {
    Constant(u32),
    /// These upper 16 bits above the lower ones that are there.
    Upper(u16),
    /// Another register plus a number.
    Sum(u8, i32),
    /// The same, with so many of its lower bits cleared.
    Aligned(u8),
}

/// The instruction at `address`, and its length in bytes. `None` where `code` ends within it.
pub(super) fn decode(code: &[u8], address: u32) -> Option<(Op, u32)> {
    let first = u16::from_le_bytes(*code.first_chunk()?);
    if first >> 11 < 0b11101 {
        return Some((narrow(first, address), 2));
    }
    let second = u16::from_le_bytes(*code.get(2..)?.first_chunk()?);
    Some((wide(first, second, address), 4))
}

/// A 16-bit instruction.
fn narrow(word: u16, address: u32) -> Op {
    let bits = |low: u32, count: u32| u32::from(word >> low) & ((1 << count) - 1);
    let register = bits(3, 4) as u8; // of those that take any register
    let destination = (bits(0, 3) | bits(7, 1) << 3) as u8;
    let to = |offset: i32| address.wrapping_add(4).wrapping_add_signed(offset);
    match word {
        0xb400..=0xb5ff => Op::Stack(4 * bits(0, 9).count_ones() as i32), // PUSH
        0xbc00..=0xbdff => {
            let freed = -4 * bits(0, 9).count_ones() as i32; // POP
            if bits(8, 1) == 1 { Op::Return(freed) } else { Op::Stack(freed) }
        }
        0xb000..=0xb07f => Op::Stack(-4 * bits(0, 7) as i32), // ADD SP, #
        0xb080..=0xb0ff => Op::Stack(4 * bits(0, 7) as i32),  // SUB SP, #
        0xa800..=0xafff => Op::Set(bits(8, 3) as u8, Value::Sum(SP, 4 * bits(0, 8) as i32)), // ADD Rd, SP, #
        0x2000..=0x27ff => Op::Set(bits(8, 3) as u8, Value::Constant(bits(0, 8))), // MOVS Rd, #
        0x4600..=0x46ff => set(destination, register, 0),     // MOV
        0x4400..=0x44ff if destination == SP => Op::StackUnknown, // ADD SP, Rm
        0x4400..=0x44ff if destination == PC => Op::Jump,     // ADD PC, Rm
        0x4700..=0x477f if register == LR => Op::Return(0),   // BX LR
        0x4700..=0x477f => Op::Jump,                          // BX
        0x4780..=0x47ff => Op::CallRegister,                  // BLX
        0xde00..=0xdeff => Op::Trap,                          // UDF
        0xd000..=0xddff => Op::Branch(to(signed(bits(0, 8), 8) * 2), true), // B<cond>
        0xe000..=0xe7ff => Op::Branch(to(signed(bits(0, 11), 11) * 2), false), // B
        _ if word & 0xf500 == 0xb100 => {
            Op::Branch(to((bits(9, 1) << 6 | bits(3, 5) << 1) as i32), true) // CBZ, CBNZ
        }
        0xbf00..=0xbfff if bits(0, 4) != 0 => Op::IfThen(4 - bits(0, 4).trailing_zeros() as u8), // IT
        _ => Op::Other,
    }
}

/// A 32-bit instruction.
fn wide(first: u16, second: u16, address: u32) -> Op {
    match first {
        0xe800..=0xe9ff => load_store_several(first, second),
        0xea00..=0xebff => shifted_register(first, second),
        0xec00..=0xedff => load_store_floats(first, second),
        0xf000..=0xf7ff if second & 0x8000 != 0 => branch(first, second, address),
        0xf000..=0xf7ff => immediate(first, second, address),
        0xf800..=0xf9ff => load_store_one(first, second),
        _ => Op::Other,
    }
}

/// STM, LDM, STRD, LDRD and table branches (A5.3.5, A5.3.6).
fn load_store_several(first: u16, second: u16) -> Op {
    let base = (first & 15) as u8;
    if first & 0xfff0 == 0xe8d0 && second & 0xffe0 == 0xf000 {
        return Op::Table(base, second & 0x10 != 0); // TBB, TBH
    }
    if first & 0x40 != 0 {
        let writes_back = first & 0x20 != 0;
        let bytes = 4 * i32::from(second & 0xff);
        let moved = if first & 0x80 != 0 { bytes } else { -bytes };
        return if writes_back && base == SP { Op::Stack(-moved) } else { Op::Other };
    }
    let bytes = 4 * second.count_ones() as i32;
    let (is_load, loads_pc) = (first & 0x10 != 0, second & 0x8000 != 0);
    match first {
        0xe92d => Op::Stack(bytes),               // STMDB SP!
        0xe8bd if loads_pc => Op::Return(-bytes), // LDM SP! with PC
        0xe8bd => Op::Stack(-bytes),              // LDM SP!
        _ if is_load && loads_pc => Op::Jump,     // LDM Rn with PC
        0xe8ad | 0xe93d => Op::StackUnknown,      // the wrong way round for a stack
        _ => Op::Other,
    }
}

/// ADD, SUB and MOV of registers (A5.3.11).
fn shifted_register(first: u16, second: u16) -> Op {
    let (operand, destination, register) =
        ((first & 15) as u8, (second >> 8 & 15) as u8, (second & 15) as u8);
    let is_shifted = second & 0x70f0 != 0;
    match first & 0xffe0 {
        0xea40 if first & 15 == 15 && !is_shifted => set(destination, register, 0), // MOV.W
        0xeba0 if destination == SP && operand == SP && !is_shifted => Op::StackByRegister(register), // SUB.W
        0xea00..=0xebe0 if destination == SP => Op::StackUnknown,
        _ => Op::Other,
    }
}

/// VPUSH, VPOP and what else stores or loads floats with the stack pointer written back (A6.5).
fn load_store_floats(first: u16, second: u16) -> Op {
    let is_floats = second & 0x0e00 == 0x0a00;
    let writes_back = first & 0x20 != 0;
    if !is_floats || !writes_back || first & 15 != u16::from(SP) {
        return Op::Other;
    }
    let bytes = 4 * i32::from(second & 0xff); // doubles count as two words
    Op::Stack(if first & 0x80 != 0 { -bytes } else { bytes })
}

/// BL, B.W and UDF.W (A5.3.4).
fn branch(first: u16, second: u16, address: u32) -> Op {
    let bit = |word: u16, at: u32| u32::from(word >> at & 1);
    let (sign, j1, j2) = (bit(first, 10), bit(second, 13), bit(second, 11));
    let low = u32::from(second & 0x7ff) << 1;
    let to = |offset: i32| address.wrapping_add(4).wrapping_add_signed(offset);
    let far = || {
        let (i1, i2) = (1 ^ j1 ^ sign, 1 ^ j2 ^ sign);
        to(signed(sign << 24 | i1 << 23 | i2 << 22 | u32::from(first & 0x3ff) << 12 | low, 25))
    };
    match second & 0xd000 {
        0xd000 => Op::Call(far()),
        0xc000 => Op::Call(far() & !3), // BLX, to code that is not Thumb
        0x9000 => Op::Branch(far(), false),
        _ if first >> 6 & 0xe != 0xe => {
            let near = sign << 20 | j2 << 19 | j1 << 18 | u32::from(first & 0x3f) << 12 | low;
            Op::Branch(to(signed(near, 21)), true)
        }
        _ if first & 0xfff0 == 0xf7f0 && second & 0xf000 == 0xa000 => Op::Trap,
        _ => Op::Other,
    }
}

/// ADD, SUB, MOV, BIC and BFC of immediate numbers (A5.3.1, A5.3.3).
fn immediate(first: u16, second: u16, address: u32) -> Op {
    let (operand, destination) = ((first & 15) as u8, (second >> 8 & 15) as u8);
    let plain =
        u32::from(first >> 10 & 1) << 11 | u32::from(second >> 12 & 7) << 8 | u32::from(second & 0xff);
    let half = (u32::from(first & 15) << 12 | plain) as u16;
    let expanded = || expand(plain);
    match first & 0xfbe0 {
        0xf100 if destination != PC => set(destination, operand, expanded() as i32), // ADD.W
        0xf1a0 if destination != PC => set(destination, operand, (expanded() as i32).wrapping_neg()), // SUB.W
        0xf200 if operand == PC => {
            Op::Set(destination, Value::Constant(counter(address).wrapping_add(plain)))
        } // ADR.W
        0xf200 if operand != PC => set(destination, operand, plain as i32),          // ADDW
        0xf2a0 if operand != PC => set(destination, operand, -(plain as i32)),       // SUBW
        0xf040 if operand == PC => Op::Set(destination, Value::Constant(expanded())), // MOV.W
        0xf240 => Op::Set(destination, Value::Constant(half.into())),                // MOVW
        0xf2c0 => Op::Set(destination, Value::Upper(half)),                          // MOVT
        0xf020 if destination == operand && (expanded() + 1).is_power_of_two() => {
            Op::Set(destination, Value::Aligned((expanded() + 1).trailing_zeros() as u8)) // BIC
        }
        0xf360 if operand == PC && second & 0x70c0 == 0 => {
            Op::Set(destination, Value::Aligned((second & 31) as u8 + 1)) // BFC Rd, #0, #
        }
        _ if destination == SP && first & 0xfbf0 != 0xf380 => Op::StackUnknown,
        _ => Op::Other,
    }
}

/// What addresses near an instruction are counted from.
fn counter(address: u32) -> u32 {
    (address & !3).wrapping_add(4)
}

/// STR and LDR of one register (A5.3.7 to A5.3.10).
fn load_store_one(first: u16, second: u16) -> Op {
    let is_on_stack = first & 15 == u16::from(SP);
    let writes_back = first & 0x80 == 0 && second & 0x0900 == 0x0900 && first & 15 != 15;
    let grown = match second & 0xff {
        bytes if second & 0x200 != 0 => -i32::from(bytes),
        bytes => i32::from(bytes),
    };
    let loads_pc = first & 0xff70 == 0xf850 && second >> 12 == 15;
    match (is_on_stack && writes_back, loads_pc) {
        (true, true) => Op::Return(grown), // LDR PC, [SP], #4
        (true, false) => Op::Stack(grown),
        (false, true) => Op::Jump,
        (false, false) => Op::Other,
    }
}

/// The effect of putting `register + add` into `destination`.
fn set(destination: u8, register: u8, add: i32) -> Op {
    match (destination, register) {
        (SP, SP) => Op::Stack(add.wrapping_neg()),
        (SP, _) => Op::StackFrom(register, add),
        (PC, LR) => Op::Return(0),
        (PC, _) => Op::Jump,
        _ => Op::Set(destination, Value::Sum(register, add)),
    }
}

/// The number that 12 bits of an instruction stand for (A5.3.2, `ThumbExpandImm`).
fn expand(bits: u32) -> u32 {
    let byte = bits & 0xff;
    match bits >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte * 0x0101_0101,
        _ => (0x80 | bits & 0x7f).rotate_right(bits >> 7),
    }
}

/// The two's complement number in the lower `count` bits.
fn signed(bits: u32, count: u32) -> i32 {
    (bits << (32 - count)) as i32 >> (32 - count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The only instruction in `code`, at an address where branches of every length have room.
    fn op(code: &[u8]) -> Op {
        let (op, length) = decode(code, 0x0200_0000).unwrap();
        assert_eq!(length as usize, code.len());
        op
    }

    // The bytes are those of LLVM's assembler.

    #[test]
    fn truth_what_grows_the_stack() {
        for (assembly, code, bytes) in [
            ("push {r4, r5, r6, r7, lr}", &[0xf0, 0xb5][..], 20),
            ("push.w {r8, r9, r10, r11}", &[0x2d, 0xe9, 0x00, 0x0f], 16),
            ("str r8, [sp, #-4]!", &[0x4d, 0xf8, 0x04, 0x8d], 4),
            ("str lr, [sp, #-8]!", &[0x4d, 0xf8, 0x08, 0xed], 8),
            ("strd r4, r5, [sp, #-16]!", &[0x6d, 0xe9, 0x04, 0x45], 16),
            ("vpush {d8, d9, d10}", &[0x2d, 0xed, 0x06, 0x8b], 24),
            ("vpush {s16}", &[0x2d, 0xed, 0x01, 0x8a], 4),
            ("sub sp, #508", &[0xff, 0xb0], 508),
            ("sub.w sp, sp, #1032", &[0xad, 0xf5, 0x81, 0x6d], 1032),
            ("subw sp, sp, #2076", &[0xad, 0xf6, 0x1c, 0x0d], 2076),
            ("sub.w sp, sp, #73728", &[0xad, 0xf5, 0x90, 0x3d], 73728),
        ] {
            assert_eq!(op(code), Op::Stack(bytes), "{assembly}");
        }
        assert_eq!(op(&[0xad, 0xeb, 0x0c, 0x0d]), Op::StackByRegister(12)); // sub.w sp, sp, r12
    }

    #[test]
    fn truth_what_shrinks_the_stack() {
        for (assembly, code, bytes) in [
            ("add sp, #16", &[0x04, 0xb0][..], 16),
            ("add.w sp, sp, #1024", &[0x0d, 0xf5, 0x80, 0x6d], 1024),
            ("addw sp, sp, #1036", &[0x0d, 0xf2, 0x0c, 0x4d], 1036),
            ("vpop {d8}", &[0xbd, 0xec, 0x02, 0x8b], 8),
            ("ldr r8, [sp], #4", &[0x5d, 0xf8, 0x04, 0x8b], 4),
            ("ldrd r4, r5, [sp], #16", &[0xfd, 0xe8, 0x04, 0x45], 16),
            ("pop {r4, r5}", &[0x30, 0xbc], 8),
            ("pop.w {r8, r9}", &[0xbd, 0xe8, 0x00, 0x03], 8),
        ] {
            assert_eq!(op(code), Op::Stack(-bytes), "{assembly}");
        }
    }

    #[test]
    fn truth_returns_and_other_ways_out() {
        for (assembly, code, expected) in [
            ("pop {r7, pc}", &[0x80, 0xbd][..], Op::Return(-8)),
            ("pop.w {r4, r8, pc}", &[0xbd, 0xe8, 0x10, 0x81], Op::Return(-12)),
            ("ldr pc, [sp], #4", &[0x5d, 0xf8, 0x04, 0xfb], Op::Return(-4)),
            ("bx lr", &[0x70, 0x47], Op::Return(0)),
            ("mov pc, lr", &[0xf7, 0x46], Op::Return(0)),
            ("bx r3", &[0x18, 0x47], Op::Jump),
            ("ldr.w pc, [r0, #4]", &[0xd0, 0xf8, 0x04, 0xf0], Op::Jump),
            ("ldr.w pc, [r0, r1, lsl #2]", &[0x50, 0xf8, 0x21, 0xf0], Op::Jump),
            ("blx r3", &[0x98, 0x47], Op::CallRegister),
            ("tbb [pc, r1]", &[0xdf, 0xe8, 0x01, 0xf0], Op::Table(PC, false)),
            ("tbh [pc, r1, lsl #1]", &[0xdf, 0xe8, 0x11, 0xf0], Op::Table(PC, true)),
            ("tbh [r1, r5, lsl #1]", &[0xd1, 0xe8, 0x15, 0xf0], Op::Table(1, true)),
            ("it eq", &[0x08, 0xbf], Op::IfThen(1)),
            ("itttt ne", &[0x1f, 0xbf], Op::IfThen(4)),
            ("udf #254", &[0xfe, 0xde], Op::Trap),
            ("udf.w #1", &[0xf0, 0xf7, 0x01, 0xa0], Op::Trap),
        ] {
            assert_eq!(op(code), expected, "{assembly}");
        }
    }

    #[test]
    fn truth_branches_reach_as_far_as_they_can() {
        let to = |offset: i32| 0x0200_0004_u32.wrapping_add_signed(offset);
        for (assembly, code, expected) in [
            ("cbz r0, #126", &[0xf8, 0xb3][..], Op::Branch(to(126), true)),
            ("cbnz r1, #0", &[0x01, 0xb9], Op::Branch(to(0), true)),
            ("b #-2048", &[0x00, 0xe4], Op::Branch(to(-2048), false)),
            ("beq #-256", &[0x80, 0xd0], Op::Branch(to(-256), true)),
            ("b.w #1048576", &[0x00, 0xf1, 0x00, 0xb8], Op::Branch(to(1_048_576), false)),
            ("bne.w #-524288", &[0x40, 0xf4, 0x00, 0x88], Op::Branch(to(-524_288), true)),
            ("bl #-16777216", &[0x00, 0xf4, 0x00, 0xd0], Op::Call(to(-16_777_216))),
            ("bl #16777214", &[0xff, 0xf3, 0xff, 0xd7], Op::Call(to(16_777_214))),
        ] {
            assert_eq!(op(code), expected, "{assembly}");
        }
    }

    #[test]
    fn truth_what_registers_are_known_to_hold() {
        for (assembly, code, register, value) in [
            ("add r7, sp, #12", &[0x03, 0xaf][..], 7, Value::Sum(SP, 12)),
            ("add.w r7, sp, #8", &[0x0d, 0xf1, 0x08, 0x07], 7, Value::Sum(SP, 8)),
            ("sub.w r4, r7, #24", &[0xa7, 0xf1, 0x18, 0x04], 4, Value::Sum(7, -24)),
            ("mov r0, r1", &[0x08, 0x46], 0, Value::Sum(1, 0)),
            ("bfc r4, #0, #4", &[0x6f, 0xf3, 0x03, 0x04], 4, Value::Aligned(4)),
            ("bic r4, r4, #31", &[0x24, 0xf0, 0x1f, 0x04], 4, Value::Aligned(5)),
            ("adr.w r1, #16", &[0x0f, 0xf2, 0x10, 0x01], 1, Value::Constant(0x0200_0014)),
            ("movw r12, #9000", &[0x42, 0xf2, 0x28, 0x3c], 12, Value::Constant(9000)),
            ("movt r12, #1", &[0xc0, 0xf2, 0x01, 0x0c], 12, Value::Upper(1)),
            ("mov.w r4, #4096", &[0x4f, 0xf4, 0x80, 0x54], 4, Value::Constant(4096)),
        ] {
            assert_eq!(op(code), Op::Set(register, value), "{assembly}");
        }
        assert_eq!(op(&[0xa5, 0x46]), Op::StackFrom(4, 0)); // mov sp, r4
        assert_eq!(op(&[0x4f, 0xea, 0x04, 0x0d]), Op::StackFrom(4, 0)); // mov.w sp, r4
        assert_eq!(op(&[0xa5, 0x44]), Op::StackUnknown); // add sp, r4
        assert_eq!(op(&[0x0d, 0xeb, 0x01, 0x0d]), Op::StackUnknown); // add.w sp, sp, r1
    }

    #[test]
    fn truth_what_only_looks_as_if_it_moved_the_stack() {
        for (assembly, code) in [
            ("ldr r0, [sp, #4]", &[0x01, 0x98][..]),
            ("str.w r0, [sp, #400]", &[0xcd, 0xf8, 0x90, 0x01]),
            ("strd r0, r1, [sp, #8]", &[0xcd, 0xe9, 0x02, 0x01]),
            ("ldr r0, [r1], #4", &[0x51, 0xf8, 0x04, 0x0b]),
            ("vstr d8, [sp, #8]", &[0x8d, 0xed, 0x02, 0x8b]),
            ("vstmia r0!, {s0, s1}", &[0xa0, 0xec, 0x02, 0x0a]),
            ("stm.w sp, {r0, r1, r2}", &[0x8d, 0xe8, 0x07, 0x00]),
            ("ldm.w r0, {r1, r2, r3}", &[0x90, 0xe8, 0x0e, 0x00]),
            ("cmp.w r0, #4096", &[0xb0, 0xf5, 0x80, 0x5f]),
            ("msr msp, r0", &[0x80, 0xf3, 0x08, 0x88]),
            ("ldrex r0, [r1]", &[0x51, 0xe8, 0x00, 0x0f]),
            ("strex r0, r1, [sp]", &[0x4d, 0xe8, 0x00, 0x10]),
            ("bkpt #0xab (semihosting)", &[0xab, 0xbe]),
            ("svc #0", &[0x00, 0xdf]),
            ("dmb sy", &[0xbf, 0xf3, 0x5f, 0x8f]),
            ("uxth.w r8, r1", &[0x1f, 0xfa, 0x81, 0xf8]),
        ] {
            assert_eq!(op(code), Op::Other, "{assembly}");
        }
    }

    #[test]
    fn an_instruction_cut_short_is_none() {
        assert_eq!(decode(&[], 0), None);
        assert_eq!(decode(&[0xf0], 0), None);
        assert_eq!(decode(&[0x2d, 0xe9, 0x00], 0), None);
    }
}
