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
        vector(out, s.wind.map(|w| w.velocity_ned_mps))?;
        vector(out, s.wind.map(|w| w.half_width_mps))?;
        vector(out, s.wrench.map(|w| w.force_ned_n))?;
        vector(out, s.wrench.map(|w| w.force_half_width_n))?;
        vector(out, s.wrench.map(|w| w.torque_frd_nm))?;
        vector(out, s.wrench.map(|w| w.torque_half_width_nm))?;
        write!(out, ",{:?},", s.verdict)?;
        faults(out, s.faults)?;
        writeln!(out)
    }

    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Three fields; one that is not finite stays empty.
fn vector(out: &mut impl Write, v: Option<Vector3<f64>>) -> io::Result<()> {
    for i in 0..3 {
        match v.map(|v| v[i]) {
            // single precision, as on the wire: what is read here equals what a ground station decodes
            Some(x) if x.is_finite() => write!(out, ",{}", x as f32)?,
            _ => write!(out, ",")?,
        }
    }
    Ok(())
}

fn faults(out: &mut impl Write, mask: FaultMask) -> io::Result<()> {
    for (i, name) in mask.names().enumerate() {
        write!(out, "{}{name}", if i > 0 { ";" } else { "" })?;
    }
    Ok(())
}
