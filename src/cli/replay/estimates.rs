use crate::outputs::half_widths;
use crate::pipeline::{FaultMask, Snapshot};
use nalgebra::Vector3;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

const HEADER: &str = "system,t_boot_s,received_unix_s,\
wind_n,wind_e,wind_d,wind_n_hw,wind_e_hw,wind_d_hw,\
force_n,force_e,force_d,force_n_hw,force_e_hw,force_d_hw,\
torque_x,torque_y,torque_z,torque_x_hw,torque_y_hw,torque_z_hw,verdict,faults";

/// Writes one CSV row for each snapshot; an empty field means "no estimate now".
pub struct EstimatesCsv {
    out: BufWriter<File>,
}

impl EstimatesCsv {
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut out = BufWriter::new(File::create(path)?);
        writeln!(out, "{HEADER}")?;
        Ok(Self { out })
    }

    pub fn row(&mut self, s: &Snapshot<'_>) -> io::Result<()> {
        let out = &mut self.out;
        let received_s = s.received_unix_us as f64 * 1e-6;
        write!(out, "{},{:.6},{received_s:.6}", s.vehicle.system, s.stamp.secs())?;
        bounded(out, s.wind.map(|w| (w.velocity_ned_mps, w.half_width_mps)))?;
        bounded(out, s.wrench.map(|w| (w.force_ned_n, w.force_half_width_n)))?;
        bounded(out, s.wrench.map(|w| (w.torque_frd_nm, w.torque_half_width_nm)))?;
        write!(out, ",{:?},", s.verdict)?;
        faults(out, s.faults, s.fault_candidates)?;
        writeln!(out)
    }

    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Six fields: three values, then their half-widths. One that is not finite stays empty.
///
/// Rounded to single precision just as on the wire: what stands here equals what a ground station decodes.
fn bounded(out: &mut impl Write, estimate: Option<(Vector3<f64>, Vector3<f64>)>) -> io::Result<()> {
    let fields = estimate.map_or([f32::NAN; 6], |(values, widths)| {
        let [a, b, c] = half_widths(&values, &widths);
        [values.x as f32, values.y as f32, values.z as f32, a, b, c]
    });
    for x in fields {
        if x.is_finite() { write!(out, ",{x}")? } else { write!(out, ",")? }
    }
    Ok(())
}

/// `gyro;rotor_2|rotor_6`: these are present, of the last one or the other.
fn faults(out: &mut impl Write, mask: FaultMask, candidates: FaultMask) -> io::Result<()> {
    for (i, name) in mask.names().enumerate() {
        write!(out, "{}{name}", if i > 0 { ";" } else { "" })?;
    }
    if candidates.0 != 0 {
        write!(out, "{}{}", if mask.0 != 0 { ";" } else { "" }, candidates.one_of())?;
    }
    Ok(())
}
