use crc::{CRC_16_MCRF4XX, Crc, Table};

/// MAVLink's checksum reads sixteen bytes at a time here: on the way of every frame it was a tenth of all work.
static CHECKSUM: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_MCRF4XX);

/// The checksum of a frame from behind its magic byte to the payload's end, with the message's CRC_EXTRA.
pub(super) fn checksum(bytes: &[u8], crc_extra: u8) -> u16 {
    let mut digest = CHECKSUM.digest();
    digest.update(bytes);
    digest.update(&[crc_extra]);
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_mavlinks(bytes in prop::collection::vec(any::<u8>(), 0..300), crc_extra: u8) {
            prop_assert_eq!(checksum(&bytes, crc_extra), mavlink_core::calculate_crc(&bytes, crc_extra));
        }
    }
}
