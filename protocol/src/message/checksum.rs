//! Checksum of a mission's lanes.

use crc::{CRC_32_ISO_HDLC, Crc, Table};

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// CRC-32 (ISO-HDLC) over all waypoints of a mission, east and north of each in millimetres as
/// little-endian `i32`: the `lanes_crc` of [`Command::UploadCommit`](super::Command::UploadCommit).
#[must_use]
pub fn lanes_crc(waypoints_mm: &[[i32; 2]]) -> u32 {
    let mut digest = CRC.digest();
    for mm in waypoints_mm.iter().flatten() {
        digest.update(&mm.to_le_bytes());
    }
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_of_the_catalogue() {
        // "123456789" is the catalogue's check input; its first eight bytes make one waypoint.
        let waypoint = [i32::from_le_bytes(*b"1234"), i32::from_le_bytes(*b"5678")];
        assert_eq!(lanes_crc(&[waypoint]), Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(b"12345678"));
        assert_eq!(Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(b"123456789"), 0xCBF4_3926);
    }
}
