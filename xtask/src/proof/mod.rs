//! What can be known of an image without running it: that a function cannot panic, allocate or recurse,
//! and how much stack it takes at most.
//!
//! The image itself is read, after the compiler and the linker have done all they do. From the symbol
//! table come its functions, from their instructions the calls among them and the stack that each holds
//! while it calls. What this reading cannot follow, above all a call of an address that is calculated, is a fault
//! as well: a bound with a hole in it is none.

mod demangle;
mod elf;
mod flow;
mod graph;
mod thumb;

use std::collections::BTreeMap;
use std::fmt;

use demangle::demangle;
use elf::Elf;
use graph::{Function, Graph};

/// Where the flight code begins: an exported function around the step, or the step itself as the newer
/// and the older mangling name it.
const STEP: [&str; 3] = [
    "skyroost_step",
    "<skyroost_firmware::agent::FlightAgent>::step",
    "skyroost_firmware::agent::FlightAgent::step",
];

/// Where the image begins.
const ENTRY: &str = "Reset";

/// What was found out of a function and all that it calls.
#[derive(Debug)]
pub(crate) struct Proof {
    root: String,
    /// How many functions the root can get to, itself included.
    reached: usize,
    /// The most stack that its callers hold meanwhile, as far as can be read, in bytes.
    pub(crate) above_bytes: u32,
    /// The functions on the way that takes the most stack, each with the bytes it holds then.
    chain: Vec<(String, u32)>,
    /// Whatever keeps the function from being safe to call in flight; empty if it is.
    pub(crate) faults: Vec<String>,
}

impl Proof {
    /// Reads an image and follows the function `root`, by default the flight code's step.
    ///
    /// # Errors
    /// The image cannot be read, or has no such function.
    pub(crate) fn of(image: &[u8], root: Option<&str>) -> Result<Self, String> {
        let mut graph = Graph::of(&Elf::of(image)?);
        let found = match root {
            Some(name) => graph.find(name),
            None => STEP.iter().find_map(|name| graph.find(name)),
        };
        let found = found.ok_or_else(|| {
            format!("the image has no function {}", root.unwrap_or("skyroost_step, nor FlightAgent::step"))
        })?;
        // What comes after a panic has begun is no part of the flight.
        graph.cut(|function| forbidden_as(function).is_some());
        Ok(Self::of_graph(&graph, found))
    }

    fn of_graph(graph: &Graph, root: usize) -> Self {
        let reached = graph.reached(root);
        let name = |function: usize| graph.functions[function].name.clone();
        let mut faults = Vec::new();
        if let Some(cycle) = graph.recursion(root) {
            let names: Vec<_> = cycle.iter().chain(cycle.first()).map(|function| name(*function)).collect();
            faults.push(format!("recursion: {}", names.join(" -> ")));
        }
        faults.extend(forbidden_calls(graph, &reached));
        for function in reached.keys().filter(|index| forbidden_as(&graph.functions[**index]).is_none()) {
            let Function { name, flow, .. } = &graph.functions[*function];
            let at = |addresses: &[u32]| {
                addresses.iter().map(|address| format!("{address:#x}")).collect::<Vec<_>>().join(", ")
            };
            if !flow.indirect.is_empty() {
                faults.push(format!("a call of a calculated address: {name} at {}", at(&flow.indirect)));
            }
            if !flow.traps.is_empty() {
                faults.push(format!("an instruction that faults: {name} at {}", at(&flow.traps)));
            }
            faults.extend(flow.unknown.iter().map(|what| format!("not understood: {name}, {what}")));
        }
        let deepest = graph.deepest(root);
        let chain = deepest.iter().map(|link| (name(link.function), link.bytes)).collect();
        let above_bytes = graph.depth_above(root, graph.find(ENTRY));
        Self { root: name(root), reached: reached.len(), above_bytes, chain, faults }
    }

    /// The most stack that the function can take, in bytes; none where it calls itself.
    pub(crate) fn stack_bytes(&self) -> Option<u64> {
        let bytes = self.chain.iter().map(|(_, bytes)| u64::from(*bytes)).sum();
        (!self.chain.is_empty()).then_some(bytes)
    }
}

impl fmt::Display for Proof {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n{:6} functions reached", self.root, self.reached)?;
        if let Some(bytes) = self.stack_bytes() {
            write!(f, "\n{bytes:6} bytes of stack at most:")?;
        }
        for (name, bytes) in &self.chain {
            write!(f, "\n{bytes:12}  {name}")?;
        }
        write!(f, "\n{:6} bytes of stack in those who call it", self.above_bytes)
    }
}

/// Every call of what must not be called, with a way that leads there.
fn forbidden_calls(graph: &Graph, reached: &BTreeMap<usize, usize>) -> Vec<String> {
    let mut faults = Vec::new();
    for &caller in reached.keys() {
        for called in graph.called_by(caller) {
            if let Some(what) = forbidden_as(&graph.functions[called]) {
                let mut way = graph.way(reached, caller);
                way.push(&graph.functions[called].name);
                let fault = format!("{what}: {}", way.join(" -> "));
                if !faults.contains(&fault) {
                    faults.push(fault);
                }
            }
        }
    }
    faults
}

/// What a function is by any of its names that has no place in flight code: compilers fold equal functions.
fn forbidden_as(function: &Function) -> Option<&'static str> {
    function.symbols.iter().find_map(|symbol| forbidden(&demangle(symbol)))
}

/// What a function of this name stands for that has no place in flight code.
fn forbidden(name: &str) -> Option<&'static str> {
    let is_in = |module: &str| name.starts_with(module) || name.starts_with(&format!("<{module}"));
    let is_panic = is_in("core::panicking::")
        || ["rust_begin_unwind", "rust_panic", "panic_fmt", "_defmt_panic"]
            .iter()
            .any(|part| name.contains(part))
        || name.contains("9panicking"); // of a name that could not be made readable
    let allocates = is_in("alloc::")
        || ["__rust_alloc", "__rust_realloc", "__rust_dealloc", "__rg_"]
            .iter()
            .any(|part| name.contains(part));
    match (is_panic, allocates) {
        (true, _) => Some("panic"),
        (_, true) => Some("allocation"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of functions of four halfwords each, from 0x100 on: push {r4, lr}, `bl` to the function of
    /// the given number, and pop {r4, pc}; without a number, two `nop`s instead.
    fn image(functions: &[(&str, Option<usize>)]) -> Vec<u8> {
        let mut code = Vec::new();
        let mut symbols = Vec::new();
        for (index, (name, called)) in functions.iter().enumerate() {
            symbols.push((*name, 0x101 + 8 * index as u32, 8, 2));
            let offset = called.map(|called| (8 * called as i32 - 8 * index as i32 - 6) >> 1);
            let call = offset.map_or([0xbf00; 2], |offset| {
                [0xf000 | (offset >> 11) as u16 & 0x7ff, 0xf800 | offset as u16 & 0x7ff]
            });
            let halves = [0xb510, call[0], call[1], 0xbd10];
            code.extend(halves.iter().flat_map(|half: &u16| half.to_le_bytes()));
        }
        elf::build::executable(0x100, &code, &symbols)
    }

    #[test]
    fn a_function_that_does_nothing_wrong_has_no_faults() {
        let proof = Proof::of(&image(&[("skyroost_step", Some(1)), ("leaf", None)]), None).unwrap();
        assert!(proof.faults.is_empty(), "{:?}", proof.faults);
        assert_eq!((proof.stack_bytes(), proof.above_bytes), (Some(16), 0));
        let shown = proof.to_string();
        assert!(shown.starts_with("skyroost_step\n     2 functions reached\n    16 bytes"), "{shown}");
    }

    #[test]
    fn recursion_below_the_step_is_a_fault_and_has_no_bound() {
        let file =
            image(&[("skyroost_step", Some(1)), ("ping", Some(2)), ("pong", Some(1)), ("apart", Some(3))]);
        let proof = Proof::of(&file, None).unwrap();
        assert_eq!(proof.faults, ["recursion: ping -> pong -> ping"]);
        assert_eq!(proof.stack_bytes(), None);
    }

    #[test]
    fn panics_and_allocations_are_faults_with_the_way_there() {
        let panic = "_RNvNtCs2pbOJsOxIua_4core9panicking5panic";
        let file =
            image(&[("skyroost_step", Some(1)), ("helper", Some(2)), (panic, Some(3)), ("handler", Some(3))]);
        let proof = Proof::of(&file, None).unwrap();
        assert_eq!(proof.faults, ["panic: skyroost_step -> helper -> core::panicking::panic"]);
        let file = image(&[("skyroost_step", Some(1)), ("__rust_alloc", None)]);
        assert_eq!(Proof::of(&file, None).unwrap().faults, ["allocation: skyroost_step -> __rust_alloc"]);
    }

    #[test]
    fn a_panic_is_known_by_any_of_its_names() {
        let halves: [u16; 5] = [0xb510, 0xf000, 0xf801, 0xbd10, 0x4770]; // push; bl 0x108; pop; bx lr
        let code: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        let panic = "_RNvNtCs2pbOJsOxIua_4core9panicking5panic";
        let symbols = [("skyroost_step", 0x101, 8, 2), ("harmless", 0x109, 2, 2), (panic, 0x109, 2, 2)];
        let file = elf::build::executable(0x100, &code, &symbols);
        assert_eq!(Proof::of(&file, None).unwrap().faults, ["panic: skyroost_step -> harmless"]);
    }

    #[test]
    fn another_root_can_be_named_and_must_be_there() {
        let file =
            image(&[("main", None), ("_RNvMNtCs1_17skyroost_firmware5agentNtB2_11FlightAgent4step", None)]);
        assert_eq!(Proof::of(&file, Some("main")).unwrap().root, "main");
        assert_eq!(Proof::of(&file, None).unwrap().root, STEP[1]);
        assert_eq!(Proof::of(&file, Some("mian")).unwrap_err(), "the image has no function mian");
        assert!(Proof::of(&image(&[("main", None)]), None).is_err());
    }

    #[test]
    fn no_code_whatever_makes_the_reading_panic() {
        let mut state: u64 = 1; // Knuth's MMIX generator
        for _ in 0..2000 {
            let code: Vec<u8> = (0..64)
                .map(|_| {
                    state =
                        state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 56) as u8
                })
                .collect();
            for address in [0x100, 0xffff_ff80] {
                let symbols =
                    [("main", address | 1, 40, 2), ("$t", address, 0, 0), ("g", address + 41, 0, 2)];
                let file = elf::build::executable(address, &code, &symbols);
                let _ = Proof::of(&file, Some("main")).map(|proof| proof.to_string());
            }
        }
    }

    #[test]
    fn names_of_panics_and_allocations() {
        for name in [
            "core::panicking::panic_fmt",
            "core::panicking::assert_failed::<u64, u64>",
            "__rustc::rust_begin_unwind",
            "_RNvNtCs_u4core9panicking5panic",
        ] {
            assert_eq!(forbidden(name), Some("panic"), "{name}");
        }
        for name in
            ["__rustc::__rust_alloc", "alloc::alloc::handle_alloc_error", "<alloc::vec::Vec<u8>>::push"]
        {
            assert_eq!(forbidden(name), Some("allocation"), "{name}");
        }
        for name in ["main", "core::panic::PanicInfo", "skyroost_firmware::localloc", "core::fmt::write"] {
            assert_eq!(forbidden(name), None, "{name}");
        }
    }
}
