//! Who calls whom in an image, and how deep that makes the stack.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::demangle::demangle;
use super::elf::{Elf, Symbol};
use super::flow::{self, Flow};

/// A function of the image.
pub(super) struct Function {
    /// Its names as the linker knows them; functions of the same code share one body.
    pub(super) symbols: Vec<String>,
    /// A name for people.
    pub(super) name: String,
    pub(super) flow: Flow,
}

/// All functions of an image and the calls among them.
pub(super) struct Graph {
    pub(super) functions: Vec<Function>,
    /// For each function, whom it calls, and its own stack in use then.
    calls: Vec<Vec<(usize, u32)>>,
}

/// A function on the way down, and the stack it holds while it calls the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link {
    pub(super) function: usize,
    pub(super) bytes: u32,
}

impl Graph {
    /// Follows every function of the image.
    pub(super) fn of(elf: &Elf<'_>) -> Self {
        let mut by_start: BTreeMap<u32, Vec<&Symbol<'_>>> = BTreeMap::new();
        for symbol in elf.functions() {
            by_start.entry(symbol.start).or_default().push(symbol);
        }
        let starts: Vec<u32> = by_start.keys().copied().collect();
        let mut functions: Vec<Function> = by_start
            .values()
            .map(|symbols| Function {
                symbols: symbols.iter().map(|symbol| symbol.name.to_owned()).collect(),
                name: demangle(symbols[0].name),
                flow: Flow::default(),
            })
            .collect();
        // Each round finds more functions that never return, because of those found before.
        let mut never_return = BTreeSet::new();
        loop {
            let known = never_return.len();
            for (function, (start, symbols)) in functions.iter_mut().zip(&by_start) {
                let end = symbols.iter().map(|symbol| symbol.end).max().unwrap_or(*start);
                function.flow = flow::follow(elf, *start, end, &never_return);
            }
            let flows = starts.iter().zip(&functions);
            never_return.extend(flows.filter(|(_, f)| f.flow.never_returns()).map(|(start, _)| *start));
            if never_return.len() == known {
                break;
            }
        }
        let mut calls = Vec::new();
        for function in &mut functions {
            let mut called = Vec::new();
            for call in &function.flow.calls {
                match starts.binary_search(&call.target) {
                    Ok(index) => called.push((index, call.depth)),
                    Err(_) => {
                        let note = format!("goes to {:#x}, where no function begins", call.target);
                        function.flow.unknown.push(note);
                    }
                }
            }
            calls.push(called);
        }
        Self { functions, calls }
    }

    /// The function of one of these names: a symbol, or the name for people.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        let is_named = |f: &Function| f.name == name || f.symbols.iter().any(|symbol| symbol == name);
        self.functions.iter().position(is_named)
    }

    /// Forgets whom the functions call that `is_end` says.
    pub(super) fn cut(&mut self, is_end: impl Fn(&Function) -> bool) {
        for (function, calls) in self.functions.iter().zip(&mut self.calls) {
            if is_end(function) {
                calls.clear();
            }
        }
    }

    /// Whom `function` calls directly.
    pub(super) fn called_by(&self, function: usize) -> impl Iterator<Item = usize> {
        self.calls[function].iter().map(|(called, _)| *called)
    }

    /// Every function that `root` can get to by direct calls, itself the first, each with the one that
    /// leads there on a shortest way.
    pub(super) fn reached(&self, root: usize) -> BTreeMap<usize, usize> {
        let mut callers = BTreeMap::from([(root, root)]);
        let mut open = VecDeque::from([root]);
        while let Some(caller) = open.pop_front() {
            for &(called, _) in &self.calls[caller] {
                callers.entry(called).or_insert_with(|| {
                    open.push_back(called);
                    caller
                });
            }
        }
        callers
    }

    /// The names on a shortest way from the root of `reached` to `function`.
    pub(super) fn way(&self, reached: &BTreeMap<usize, usize>, function: usize) -> Vec<&str> {
        let mut way = vec![self.functions[function].name.as_str()];
        let mut at = function;
        while let Some(&caller) = reached.get(&at).filter(|caller| **caller != at) {
            at = caller;
            way.push(&self.functions[at].name);
        }
        way.reverse();
        way
    }

    /// The first cycle of calls found below `root`: functions that call each other in this order.
    pub(super) fn recursion(&self, root: usize) -> Option<Vec<usize>> {
        // A function is left for good once all that it calls is; one met while it is open closes a cycle.
        let mut is_left = vec![false; self.functions.len()];
        let mut open = vec![(root, 0)];
        while let Some((function, next)) = open.last_mut() {
            let Some(&(called, _)) = self.calls[*function].get(*next) else {
                is_left[*function] = true;
                open.pop();
                continue;
            };
            *next += 1;
            if let Some(from) = open.iter().position(|(on_way, _)| *on_way == called) {
                return Some(open[from..].iter().map(|(function, _)| *function).collect());
            }
            if !is_left[called] {
                open.push((called, 0));
            }
        }
        None
    }

    /// The chain of calls from `root` that takes the most stack. To be asked only where there is no
    /// recursion; there, nothing.
    pub(super) fn deepest(&self, root: usize) -> Vec<Link> {
        if self.recursion(root).is_some() {
            return Vec::new();
        }
        let mut known: Vec<Option<(u32, Link, Option<usize>)>> = vec![None; self.functions.len()];
        self.depth_below(root, &mut known);
        let mut chain = Vec::new();
        let mut at = Some(root);
        while let Some((_, link, next)) = at.and_then(|function| known[function]) {
            chain.push(link);
            at = next;
        }
        chain
    }

    /// The most stack that callers hold while they are in `root`. Where the ways up end before `entry`, at
    /// a function that is called by pointer, all that `entry` may hold at any call by pointer counts as well.
    pub(super) fn depth_above(&self, root: usize, entry: Option<usize>) -> u32 {
        let mut callers: Vec<Vec<(usize, u32)>> = vec![Vec::new(); self.functions.len()];
        for (caller, calls) in self.calls.iter().enumerate() {
            for &(called, bytes) in calls {
                callers[called].push((caller, bytes));
            }
        }
        let mut known = vec![None; callers.len()];
        let below_entry = entry.map(|entry| self.reached(entry)).unwrap_or_default();
        let direct = deepest_caller(root, &callers, &mut known);
        if below_entry.contains_key(&root) {
            return direct;
        }
        let by_pointer = below_entry
            .keys()
            .filter(|function| !self.functions[**function].flow.indirect.is_empty())
            .map(|f| self.functions[*f].flow.frame + deepest_caller(*f, &callers, &mut known));
        direct + by_pointer.max().unwrap_or(0)
    }

    /// The most stack that `function` and what it calls take.
    fn depth_below(&self, function: usize, known: &mut [Option<(u32, Link, Option<usize>)>]) -> u32 {
        if let Some((depth, ..)) = known[function] {
            return depth;
        }
        let own = self.functions[function].flow.frame;
        let mut worst = (own, Link { function, bytes: own }, None);
        for &(called, bytes) in &self.calls[function] {
            let depth = bytes + self.depth_below(called, known);
            if depth > worst.0 {
                worst = (depth, Link { function, bytes }, Some(called));
            }
        }
        known[function] = Some(worst);
        worst.0
    }
}

/// The most stack on a way from `function` up through `callers`; a cycle is gone round once at most.
fn deepest_caller(function: usize, callers: &[Vec<(usize, u32)>], known: &mut [Option<u32>]) -> u32 {
    if let Some(depth) = known[function] {
        return depth;
    }
    known[function] = Some(0);
    let above =
        callers[function].iter().map(|&(caller, bytes)| bytes + deepest_caller(caller, callers, known));
    let depth = above.max().unwrap_or(0);
    known[function] = Some(depth);
    depth
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proof::flow::Call;

    /// A function's frame, and `(whom, depth)` it calls.
    type Sketch<'a> = (u32, &'a [(usize, u32)]);

    /// A graph of functions called a, b, c...
    fn graph(functions: &[Sketch<'_>]) -> Graph {
        let name = |index: usize| char::from(b'a' + index as u8).to_string();
        let function = |(index, (frame, _)): (usize, &Sketch<'_>)| Function {
            symbols: vec![name(index)],
            name: name(index),
            flow: Flow { frame: *frame, ..Flow::default() },
        };
        Graph {
            functions: functions.iter().enumerate().map(function).collect(),
            calls: functions.iter().map(|(_, calls)| calls.to_vec()).collect(),
        }
    }

    #[test]
    fn the_deepest_chain_counts_the_stack_in_use_at_each_call() {
        // a calls b late (8 of its 100 bytes left) and c with all of it in use.
        let graph = graph(&[(100, &[(1, 8), (2, 100)]), (150, &[]), (10, &[(3, 10)]), (30, &[])]);
        let bytes = |chain: &[Link]| chain.iter().map(|link| (link.function, link.bytes)).collect::<Vec<_>>();
        assert_eq!(bytes(&graph.deepest(0)), [(0, 8), (1, 150)]);
        assert_eq!(bytes(&graph.deepest(2)), [(2, 10), (3, 30)]);
    }

    #[test]
    fn callers_hold_stack_too() {
        // b calls a with 20 bytes in use; c calls d with 10 and d calls a with 30.
        let mut graph = graph(&[
            (90, &[]),
            (50, &[(0, 20)]),
            (10, &[(3, 10)]),
            (30, &[(0, 30)]),
            (8, &[(5, 8)]),
            (100, &[]),
        ]);
        assert_eq!((graph.depth_above(0, None), graph.depth_above(1, None)), (40, 0));
        // e is the entry and gets to f, which calls by pointer: b or c, for all one knows.
        graph.functions[5].flow.indirect.push(0x100);
        assert_eq!((graph.depth_above(0, Some(4)), graph.depth_above(0, Some(2))), (40 + 8 + 100, 40));
    }

    #[test]
    fn recursion_is_found_with_the_functions_in_it() {
        let graph =
            graph(&[(0, &[(1, 0), (3, 0)]), (8, &[(2, 8)]), (8, &[(1, 8)]), (0, &[(3, 0)]), (0, &[])]);
        assert_eq!(graph.recursion(0), Some(vec![1, 2]));
        assert_eq!(graph.recursion(3), Some(vec![3])); // calls itself
        assert_eq!(graph.recursion(4), None);
        assert!(graph.deepest(0).is_empty());
    }

    #[test]
    fn two_ways_to_one_function_are_no_recursion() {
        let graph = graph(&[(0, &[(1, 0), (2, 0)]), (0, &[(3, 0)]), (0, &[(3, 0)]), (0, &[])]);
        assert_eq!(graph.recursion(0), None);
        assert_eq!(graph.way(&graph.reached(0), 3), ["a", "b", "d"]);
        assert_eq!(graph.reached(1).len(), 2);
    }

    #[test]
    fn an_image_is_cut_into_functions_by_its_symbols() {
        use crate::proof::elf::build::executable;
        // 0x100 outer, also called alias: push {r4, lr}; bl 0x108; pop {r4, pc}. 0x108 inner: bx lr; a
        // half of padding; b.w to 0x200, where there is nothing.
        let halves: [u16; 8] = [0xb510, 0xf000, 0xf801, 0xbd10, 0x4770, 0xbf00, 0xf000, 0xb878];
        let code: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        let symbols =
            [("outer", 0x101, 8, 2), ("alias", 0x101, 8, 2), ("inner", 0x109, 2, 2), ("lost", 0x10d, 4, 2)];
        let file = executable(0x100, &code, &symbols);
        let graph = Graph::of(&Elf::of(&file).unwrap());
        let (outer, inner) = (graph.find("alias").unwrap(), graph.find("inner").unwrap());
        assert_eq!(graph.find("outer"), Some(outer));
        assert_eq!(graph.functions[outer].flow.calls, [Call { target: 0x108, depth: 8 }]);
        assert_eq!(graph.calls[outer], [(inner, 8)]);
        let lost = &graph.functions[graph.find("lost").unwrap()];
        assert_eq!(lost.flow.unknown, ["goes to 0x200, where no function begins"]);
    }
}
