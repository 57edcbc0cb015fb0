//! Proof by the linker that the flight code cannot panic.
//!
//! The image calls all that runs in flight, on values of which the compiler knows nothing but their
//! types: an agent's start, step and restart, the codec of the byte link, and the cadence of the loop. Its
//! panic handler calls [`the_flight_code_can_panic`], which nobody defines. Once the compiler has proved
//! every panic unreachable, the handler has no caller and is left out, and the image links; as long as one
//! is left, the link fails and names that function.
//!
//! The image is never run. With the feature `blame` its panic handler loops instead: it then links whatever
//! it holds, and a disassembly says who calls `core::panicking`.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::ptr::{read_volatile, with_exposed_provenance_mut};

use cortex_m as _; // the critical section
use skyroost_firmware::{
    agent::FlightAgent,
    board::cadence::Cadence,
    config::AgentConfig,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{Frame, StreamDecoder, StreamFrame, encode_stream, key::Key, units::TimePs};

/// A value that the compiler knows nothing of, and where it must write everything that is written.
fn unknown<T>() -> &'static mut T {
    static ADDRESS: usize = 0x2000_0000;
    // SAFETY: none, and none is needed: this image is linked and never run. The address is read as if
    // hardware could change it, so that no two calls are known to give the same place.
    #[expect(unsafe_code)]
    unsafe {
        &mut *with_exposed_provenance_mut(read_volatile(&raw const ADDRESS))
    }
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let agent: &mut FlightAgent = unknown();
    *agent = FlightAgent::new(*unknown::<AgentConfig>(), None);
    loop {
        unknown::<FlightAgent>().restart(*unknown::<AgentConfig>(), unknown::<Option<Key>>().take());
        unknown::<Cadence>().finished(*unknown(), *unknown());
        let (inputs, outputs): (&mut Inputs, &mut Outputs) = (unknown(), unknown());
        unknown::<FlightAgent>().step(*unknown::<TimePs>(), inputs, outputs);
        inputs.clear();
        outputs.clear();
        *unknown() = encode_stream(unknown::<Frame>(), unknown::<StreamFrame>());
        match unknown::<StreamDecoder>().push(*unknown()) {
            Some(Ok(frame)) => {
                let frame = Frame::from_slice(frame);
                *unknown() = frame.is_ok_and(|frame| inputs.frames.push(frame).is_ok());
            }
            Some(Err(error)) => *unknown() = error,
            None => {}
        }
    }
}

#[cfg(not(feature = "blame"))]
#[expect(unsafe_code)]
unsafe extern "C" {
    /// Defined nowhere.
    fn the_flight_code_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    #[cfg(not(feature = "blame"))]
    // SAFETY: the function does not exist; where this code is reachable there is no image.
    #[expect(unsafe_code)]
    unsafe {
        the_flight_code_can_panic()
    }
    #[cfg(feature = "blame")]
    loop {}
}
