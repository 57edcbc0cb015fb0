//! One function's ways: how deep its stack gets, whom it calls and how deep the stack is there.
//!
//! Every instruction that can be reached from the function's first is visited with the depth of the
//! stack before it. Compilers keep the depth the same on every way to an instruction; where it differs,
//! the deeper counts.

use std::collections::BTreeSet;

use super::elf::Elf;
use super::thumb::{self, Op, PC, SP, Value};

/// How many instructions back the definition of a register is looked for. Compilers put it right before.
const LOOK_BACK: usize = 6;

/// A depth beyond which nothing is followed, in bytes: twice the RAM there is. A loop may grow the stack.
const TOO_DEEP: i32 = 256 * 1024;

/// What a function does to the stack.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Flow {
    /// The most bytes of stack the function itself takes.
    pub(super) frame: u32,
    /// Who is called, or gone to for good, by an address in the instruction.
    pub(super) calls: Vec<Call>,
    /// Where an address out of a register or memory is called or gone to.
    pub(super) indirect: Vec<u32>,
    /// Where an instruction is reached that raises a fault.
    pub(super) traps: Vec<u32>,
    /// Whether it may get back to its caller, by itself or by the functions it goes to for good.
    pub(super) returns: bool,
    /// What this analysis could not follow, in words.
    pub(super) unknown: Vec<String>,
}

impl Flow {
    /// Whether it surely does not get back to its caller.
    pub(super) fn never_returns(&self) -> bool {
        !self.returns && self.unknown.is_empty()
    }
}

/// A call to a known address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Call {
    pub(super) target: u32,
    /// Bytes of the caller's stack in use at the call: none where the call takes the caller's place.
    pub(super) depth: u32,
}

struct Instruction {
    address: u32,
    end: u32,
    op: Op,
    /// In an IT block: the instruction after it may come next whatever this one does.
    is_conditional: bool,
}

/// Follows the function at `start..end`. What comes after a call of one that `never_return` holds is not
/// reached: compilers put anything there, data too.
pub(super) fn follow(elf: &Elf<'_>, start: u32, end: u32, never_return: &BTreeSet<u32>) -> Flow {
    let mut walk =
        Walk { elf, end, never_return, code: Vec::new(), depths: Vec::new(), flow: Flow::default() };
    walk.decode(start);
    walk.depths = vec![None; walk.code.len()];
    let mut open = Vec::new();
    walk.reach(start, start, 0, &mut open);
    while let Some(index) = open.pop() {
        walk.visit(index, &mut open);
    }
    walk.flow
}

struct Walk<'a> {
    elf: &'a Elf<'a>,
    end: u32,
    never_return: &'a BTreeSet<u32>,
    code: Vec<Instruction>,
    /// The stack's depth before each instruction, as far as visited.
    depths: Vec<Option<i32>>,
    flow: Flow,
}

impl Walk<'_> {
    fn decode(&mut self, start: u32) {
        for (mut address, end) in self.elf.instructions(start, self.end) {
            let mut conditional = 0;
            while let Some((op, length)) = thumb::decode(self.elf.bytes(address, end), address) {
                let is_conditional = conditional > 0;
                conditional = if let Op::IfThen(count) = op { count } else { conditional.saturating_sub(1) };
                self.code.push(Instruction {
                    address,
                    end: address.saturating_add(length),
                    op,
                    is_conditional,
                });
                address = address.saturating_add(length);
            }
        }
    }

    fn index_of(&self, address: u32) -> Option<usize> {
        self.code.binary_search_by_key(&address, |instruction| instruction.address).ok()
    }

    /// Notes that `target` is reached from `from` with the stack at `depth`.
    fn reach(&mut self, from: u32, target: u32, depth: i32, open: &mut Vec<usize>) {
        let Some(index) = self.index_of(target) else {
            return self.is_unknown(from, &format!("goes to {target:#x}, where no instruction begins"));
        };
        if depth > TOO_DEEP {
            return self.is_unknown(from, "the stack grows beyond 256 KiB");
        }
        if self.depths[index].is_none_or(|known| known < depth) {
            self.depths[index] = Some(depth);
            open.push(index);
        }
    }

    fn is_unknown(&mut self, address: u32, what: &str) {
        let note = format!("{address:#x}: {what}");
        if !self.flow.unknown.contains(&note) {
            self.flow.unknown.push(note);
        }
    }

    fn visit(&mut self, index: usize, open: &mut Vec<usize>) {
        let Instruction { address, end, op, is_conditional } = self.code[index];
        let depth = self.depths[index].unwrap_or(0);
        let mut after = Some(depth);
        match op {
            Op::Other | Op::IfThen(_) | Op::Set(..) => {}
            Op::Stack(grown) => after = Some(depth.saturating_add(grown)),
            Op::Return(_) => {
                self.flow.returns = true;
                after = None;
            }
            Op::StackByRegister(register) => match self.constant(index, register) {
                Some(grown) => after = Some(depth.saturating_add_unsigned(grown)),
                None => self.is_unknown(address, "grows the stack by an unknown number"),
            },
            Op::StackFrom(register, add) => match self.depth_of(index, register) {
                Some(known) => after = Some(known.saturating_sub(add)),
                None => self.is_unknown(address, "sets the stack pointer to an unknown address"),
            },
            Op::StackUnknown => self.is_unknown(address, "moves the stack pointer in an unknown way"),
            Op::Branch(target, may_pass) => {
                if self.is_inside(target) {
                    self.reach(address, target, depth, open);
                } else {
                    self.go_on_in(target, depth);
                }
                after = may_pass.then_some(depth);
            }
            Op::Call(target) => {
                self.call(target, depth);
                if self.never_return.contains(&target) {
                    after = None;
                }
            }
            Op::CallRegister => note(&mut self.flow.indirect, address),
            Op::Jump => {
                note(&mut self.flow.indirect, address);
                self.flow.returns = true;
                after = None;
            }
            Op::Table(base, of_halfwords) => {
                let start = if base == PC { Some(end) } else { self.constant(index, base) };
                for target in self.table(start, end, of_halfwords) {
                    self.reach(address, target, depth, open);
                }
                after = None;
            }
            Op::Trap => {
                note(&mut self.flow.traps, address);
                after = None;
            }
        }
        if is_conditional {
            after = after.max(Some(depth)); // done or not, whichever leaves the stack deeper
        }
        let Some(after) = after else { return };
        self.flow.frame = self.flow.frame.max(after.max(0) as u32);
        if self.is_inside(end) {
            self.reach(address, end, after, open);
        } else if op != Op::CallRegister {
            self.go_on_in(end, after); // assembly that runs on into the next function
        }
    }

    fn is_inside(&self, address: u32) -> bool {
        let start = self.code.first().map_or(self.end, |first| first.address);
        (start..self.end).contains(&address)
    }

    fn call(&mut self, target: u32, depth: i32) {
        let depth = depth.max(0) as u32;
        note(&mut self.flow.calls, Call { target, depth });
    }

    /// Goes to another function in place of returning.
    fn go_on_in(&mut self, target: u32, depth: i32) {
        self.call(target, depth);
        self.flow.returns |= !self.never_return.contains(&target);
    }

    /// Where the table at `start` leads: twice each entry, counted from `end` of the instruction (A7.7.185). Nothing says
    /// how long it is, and constants may follow it. All its entries lead to instructions, so it ends before
    /// the first that does not; what is taken too much leads into this function all the same.
    fn table(&mut self, start: Option<u32>, end: u32, of_halfwords: bool) -> Vec<u32> {
        let Some(start) = start else {
            self.is_unknown(end, "a table of branches that lies nobody knows where");
            return Vec::new();
        };
        let next = self.code.partition_point(|instruction| instruction.address < start);
        let close = self.code.get(next).map_or(self.end, |instruction| instruction.address);
        let width = if of_halfwords { 2 } else { 1 };
        let entries = self.elf.bytes(start, close).chunks_exact(width).map(|entry| match *entry {
            [low, high] => u32::from(u16::from_le_bytes([low, high])),
            _ => u32::from(entry[0]),
        });
        let targets: Vec<u32> = entries
            .map(|entry| end.saturating_add(2 * entry))
            .take_while(|target| *target < self.end && self.index_of(*target).is_some())
            .collect();
        if targets.is_empty() {
            self.is_unknown(start, "a table of branches that leads nowhere");
        }
        targets
    }

    /// The instruction shortly before `index` that sets `register`, and what to.
    fn definition(&self, index: usize, register: u8) -> Option<(usize, Value)> {
        (index.saturating_sub(LOOK_BACK)..index).rev().find_map(|before| match self.code[before].op {
            Op::Set(set, value) if set == register => Some((before, value)),
            _ => None,
        })
    }

    /// The number in `register` before the instruction `index`.
    fn constant(&self, index: usize, register: u8) -> Option<u32> {
        match self.definition(index, register)? {
            (_, Value::Constant(number)) => Some(number),
            (at, Value::Upper(upper)) => Some(self.constant(at, register)? & 0xffff | u32::from(upper) << 16),
            _ => None,
        }
    }

    /// How deep the stack would be if the stack pointer were what `register` holds at `index`.
    fn depth_of(&self, index: usize, register: u8) -> Option<i32> {
        const FRAME_POINTER: u8 = 7; // set once, in the prologue, which may be far away
        if register == SP {
            return self.depths[index];
        }
        let (at, value) = self.definition(index, register).or_else(|| {
            let is_set = |op: Op| match op {
                Op::Set(FRAME_POINTER, value @ Value::Sum(SP, _)) => Some(value),
                _ => None,
            };
            let found = || self.code.iter().enumerate().find_map(|(at, i)| Some((at, is_set(i.op)?)));
            (register == FRAME_POINTER).then(found)?
        })?;
        match value {
            Value::Sum(base, add) => Some(self.depth_of(at, base)?.saturating_sub(add)),
            // The stack is aligned to words before; at worst, all bits above those get cleared.
            Value::Aligned(bits) => {
                Some(self.depth_of(at, register)?.saturating_add((1 << bits.clamp(2, 16)) - 4))
            }
            Value::Constant(_) | Value::Upper(_) => None,
        }
    }
}

fn note<T: PartialEq>(list: &mut Vec<T>, entry: T) {
    if !list.contains(&entry) {
        list.push(entry);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proof::elf::build::executable;

    /// The flow of a function at 0x100 made of these instructions' halfwords, with data at `data`.
    fn flow(code: &[u16], data: &[(u32, u32)]) -> Flow {
        let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
        let mut symbols = vec![("f", 0x101, bytes.len() as u32, 2), ("$t", 0x100, 0, 0)];
        for &(from, to) in data {
            symbols.extend([("$d", from, 0, 0), ("$t", to, 0, 0)]);
        }
        let file = executable(0x100, &bytes, &symbols);
        follow(&Elf::of(&file).unwrap(), 0x100, 0x100 + bytes.len() as u32, &BTreeSet::from([0x300]))
    }

    #[test]
    fn a_leaf_takes_nothing() {
        assert_eq!(flow(&[0x4770], &[]), Flow { returns: true, ..Flow::default() }); // bx lr
    }

    #[test]
    fn pushes_and_locals_add_up_and_calls_see_the_depth() {
        // push {r4, lr}; sub sp, #16; bl 0x200; add sp, #16; pop {r4, pc}
        let flow = flow(&[0xb510, 0xb084, 0xf000, 0xf87c, 0xb004, 0xbd10], &[]);
        assert_eq!((flow.frame, flow.calls), (24, vec![Call { target: 0x200, depth: 24 }]));
        assert!(flow.unknown.is_empty() && flow.indirect.is_empty());
    }

    #[test]
    fn nothing_is_reached_after_a_call_that_never_returns() {
        // push {r7, lr}; bl 0x300; and data that begins like an instruction
        let flow = flow(&[0xb580, 0xf000, 0xf8fd, 0xb5f0], &[]);
        assert_eq!((flow.frame, flow.returns, flow.unknown.len()), (8, false, 0));
    }

    #[test]
    fn a_call_in_place_of_a_return_has_given_the_stack_back() {
        // push {r4, lr}; pop.w {r4, lr}; b.w 0x200
        let flow = flow(&[0xb510, 0xe8bd, 0x4010, 0xf000, 0xb87b], &[]);
        assert_eq!((flow.frame, flow.calls), (8, vec![Call { target: 0x200, depth: 0 }]));
    }

    #[test]
    fn an_early_return_does_not_hide_the_deeper_way() {
        // it eq; bxeq lr; push {r4, lr}; pop {r4, pc}
        let flow = flow(&[0xbf08, 0x4770, 0xb510, 0xbd10], &[]);
        assert_eq!((flow.frame, flow.unknown.len()), (8, 0));
    }

    #[test]
    fn the_ways_out_of_a_table_are_followed() {
        // tbb [pc, r1]: 2, 3 -> bx lr, or udf
        let flow = flow(&[0xe8df, 0xf001, 0x0302, 0xbf00, 0x4770, 0xde00], &[(0x104, 0x106)]);
        assert_eq!(flow.traps, [0x10a]);
        assert!(flow.unknown.is_empty() && flow.indirect.is_empty(), "{flow:?}");
    }

    #[test]
    fn a_table_may_lie_where_a_register_says() {
        // adr.w r1, 0x10c; tbb [r1, r0]; bx lr; nop: 0 -> bx lr, 3 -> udf
        let flow = flow(&[0xf20f, 0x0108, 0xe8d1, 0xf000, 0x4770, 0xbf00, 0x0300, 0xde00], &[(0x10c, 0x10e)]);
        assert_eq!(flow.traps, [0x10e]);
        assert!(flow.returns && flow.unknown.is_empty(), "{flow:?}");
    }

    #[test]
    fn a_table_ends_where_its_entries_lead_nowhere() {
        // tbh [pc, r1]: 4 -> bx lr; then a constant
        let flow = flow(&[0xe8df, 0xf011, 0x0004, 0xffff, 0x0004, 0xbf00, 0x4770], &[(0x104, 0x10a)]);
        assert!(flow.returns && flow.unknown.is_empty(), "{flow:?}");
    }

    #[test]
    fn a_large_frame_out_of_a_register() {
        // movw r12, #9000; movt r12, #1; sub.w sp, sp, r12; bx lr
        let code = [0xf242, 0x3c28, 0xf2c0, 0x0c01, 0xebad, 0x0d0c, 0x4770];
        assert_eq!(flow(&code, &[]).frame, 9000 + 65536);
        assert_eq!(flow(&code[4..], &[]).unknown, ["0x100: grows the stack by an unknown number"]);
    }

    #[test]
    fn an_aligned_frame_is_bounded_and_given_back() {
        // push {r4, r7, lr}; add r7, sp, #4; sub sp, #24; mov r4, sp; bfc r4, #0, #4; mov sp, r4;
        // nop; sub.w r4, r7, #4; mov sp, r4; pop {r4, r7, pc}
        let flow = flow(
            &[0xb590, 0xaf01, 0xb086, 0x466c, 0xf36f, 0x0403, 0x46a5, 0xbf00, 0xf1a7, 0x0404, 0x46a5, 0xbd90],
            &[],
        );
        assert_eq!((flow.frame, flow.unknown.len()), (12 + 24 + 12, 0), "{flow:?}");
    }

    #[test]
    fn what_cannot_be_followed_is_said() {
        assert_eq!(flow(&[0x4718], &[]).indirect, [0x100]); // bx r3
        assert_eq!(flow(&[0x4798, 0x4770], &[]).indirect, [0x100]); // blx r3; bx lr
        assert_eq!(flow(&[0x46a5, 0x4770], &[]).unknown.len(), 1); // mov sp, r4
        assert_eq!(flow(&[0xb401, 0xe7fd], &[]).unknown, ["0x100: the stack grows beyond 256 KiB"]); // push; b
        let calls = flow(&[0xb401], &[]).calls; // push {r0} and on into the next function
        assert_eq!(calls, [Call { target: 0x102, depth: 4 }]);
    }
}
