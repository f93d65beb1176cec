use super::SimVehicle;
use std::fmt::Write as _;
use std::io::{self, Write};

/// Writes the truth as CSV, one row for each instant asked for. Column names are those of the estimates file, so that
/// either can be held against the other.
#[derive(Debug)]
pub struct TruthLog<W> {
    sink: W,
    row: String,
}

const HEADER: &str = "t_boot_s,north_m,east_m,down_m,vn_mps,ve_mps,vd_mps,an_mps2,ae_mps2,ad_mps2,qw,qx,qy,qz,p_rads,q_rads,\
r_rads,fx_mps2,fy_mps2,fz_mps2,wind_n,wind_e,wind_d,air_x_mps,air_y_mps,air_z_mps,force_n,force_e,force_d,torque_x,\
torque_y,torque_z,voltage_v,armed,on_ground,faults\n";

impl<W: Write> TruthLog<W> {
    /// Writes the header. `sink` should be buffered.
    pub fn new(mut sink: W) -> io::Result<Self> {
        sink.write_all(HEADER.as_bytes())?;
        Ok(Self { sink, row: String::with_capacity(512) })
    }

    /// Appends what is true of a vehicle now; `boot_s` is its autopilot's boot time.
    pub fn write(&mut self, boot_s: f64, vehicle: &SimVehicle) -> io::Result<()> {
        let m = vehicle.now();
        let t = &m.truth;
        let q = t.body_to_ned.quaternion();
        self.row.clear();
        // writing to a String cannot fail
        let _ = write!(self.row, "{boot_s:.6}");
        let vectors = [&t.position_ned_m, &t.velocity_ned_mps, &t.acceleration_ned_mps2];
        for v in vectors {
            let _ = write!(self.row, ",{:.5},{:.5},{:.5}", v.x, v.y, v.z);
        }
        let _ = write!(self.row, ",{:.7},{:.7},{:.7},{:.7}", q.w, q.i, q.j, q.k);
        let vectors = [
            &t.rate_frd_rads,
            &t.specific_force_frd_mps2,
            &t.wind_ned_mps,
            &t.air_velocity_frd_mps,
            &t.residual_force_ned_n,
            &t.residual_torque_frd_nm,
        ];
        for v in vectors {
            let _ = write!(self.row, ",{:.6},{:.6},{:.6}", v.x, v.y, v.z);
        }
        let (armed, ground) = (u8::from(m.flight.armed()), u8::from(t.on_ground));
        let _ = write!(self.row, ",{:.3},{armed},{ground},", t.voltage_v);
        for (i, fault) in vehicle.faults().active_faults().enumerate() {
            let _ = write!(self.row, "{}{}", if i > 0 { ";" } else { "" }, fault.kind);
        }
        self.row.push('\n');
        self.sink.write_all(self.row.as_bytes())
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }
}
