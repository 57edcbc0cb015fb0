//! A hash over every output of the flight code, in time order.

use skyroost_firmware::{Vec3, io::Outputs};
use skyroost_protocol::units::DroneId;
use xxhash_rust::xxh3::Xxh3;

/// Hash over one drone's outputs: equal digests mean equal flights, to the bit.
#[derive(Clone)]
pub(super) struct Digest {
    hash: Xxh3,
}

impl Digest {
    pub(super) fn new(drone: DroneId) -> Self {
        Self { hash: Xxh3::with_seed(u64::from(drone.0)) }
    }

    /// Takes in the outputs of one step: setpoint, frames and gates, each with its length.
    pub(super) fn add(&mut self, outputs: &Outputs) {
        let setpoint = &outputs.setpoint;
        let mut bytes = [0u8; 28];
        bytes[0] = u8::from(setpoint.motors);
        bytes[1] = outputs.uplink.len() as u8;
        bytes[2] = outputs.peer.len() as u8;
        bytes[3] = outputs.srs_gates.len() as u8;
        put(&mut bytes[4..16], &setpoint.vel_enu_mps);
        put(&mut bytes[16..28], &setpoint.accel_enu_mps2);
        self.hash.update(&bytes);
        for frame in outputs.uplink.iter().chain(&outputs.peer) {
            self.hash.update(&(frame.len() as u32).to_le_bytes());
            self.hash.update(frame);
        }
        for gate in &outputs.srs_gates {
            self.hash.update(&gate.occasion.0.to_le_bytes());
            self.hash.update(&gate.user.0.to_le_bytes());
            self.hash.update(&gate.at.0.to_le_bytes());
            self.hash.update(&[u8::from(gate.grant)]);
        }
    }

    /// Digest of a whole flight from those of all drones in order of id, in hexadecimal.
    pub(super) fn combined<'a>(all: impl Iterator<Item = &'a Self>) -> String {
        let mut hash = Xxh3::new();
        for digest in all {
            hash.update(&digest.hash.digest128().to_le_bytes());
        }
        format!("{:032x}", hash.digest128())
    }
}

/// Bits of a vector; every NaN is the same one, as processors differ in which they produce.
fn put(bytes: &mut [u8], v: &Vec3) {
    for (chunk, x) in bytes.chunks_exact_mut(4).zip(v.iter()) {
        let x = if x.is_nan() { f32::NAN } else { *x };
        chunk.copy_from_slice(&x.to_bits().to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_difference_shows() {
        let digest_of = |change: &dyn Fn(&mut Outputs)| {
            let mut outputs = Outputs::default();
            change(&mut outputs);
            let mut digest = Digest::new(DroneId(1));
            digest.add(&outputs);
            Digest::combined([digest].iter())
        };
        let plain = digest_of(&|_| {});
        assert_eq!(plain, digest_of(&|_| {}));
        assert_ne!(plain, digest_of(&|o| o.setpoint.motors = true));
        assert_ne!(plain, digest_of(&|o| o.setpoint.vel_enu_mps.x = f32::MIN_POSITIVE));
        assert_ne!(plain, digest_of(&|o| o.uplink.push(skyroost_protocol::Frame::new()).unwrap()));
        assert_eq!(
            digest_of(&|o| o.setpoint.accel_enu_mps2.y = f32::from_bits(0x7fc0_0001)),
            digest_of(&|o| o.setpoint.accel_enu_mps2.y = f32::NAN)
        );
    }
}
