use nalgebra::Vector3;
use std::path::Path;

/// Reads a recorded wind: a CSV file with a header line. Time is `t_s`, `t_boot_s` (s) or `boot_ms`; the wind is
/// `wind_n`, `wind_e` and, if there, `wind_d` (m/s, towards), or `wind_from_deg` and `speed_mps`. Other columns are
/// ignored. The truth files this program writes are of this kind.
pub(super) fn wind(path: &Path) -> Result<Vec<(f64, Vector3<f64>)>, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("cannot be read: {e}"))?;
    parse(&text)
}

fn parse(text: &str) -> Result<Vec<(f64, Vector3<f64>)>, String> {
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty());
    let (_, header) = lines.next().ok_or("is empty")?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|n| *n == name);
    let (time, unit) = column("t_s")
        .or(column("t_boot_s"))
        .map(|c| (c, 1.0))
        .or(column("boot_ms").map(|c| (c, 1e-3)))
        .ok_or("has no column `t_s`, `t_boot_s` or `boot_ms`")?;
    let components = column("wind_n").zip(column("wind_e"));
    let compass = column("wind_from_deg").zip(column("speed_mps"));
    if components.is_none() && compass.is_none() {
        return Err("has neither `wind_n` and `wind_e` nor `wind_from_deg` and `speed_mps`".into());
    }
    let down = column("wind_d");
    let mut knots: Vec<(f64, Vector3<f64>)> = Vec::new();
    for (line, row) in lines {
        let fields: Vec<&str> = row.split(',').collect();
        let at = |c: usize| {
            let field = fields.get(c).copied().unwrap_or_default().trim();
            field.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| {
                format!("line {}: `{}` holds `{field}`, not a number", line + 1, names.get(c).copied().unwrap_or(""))
            })
        };
        let t = at(time)? * unit;
        let wind = match (components, compass) {
            (Some((n, e)), _) => Vector3::new(at(n)?, at(e)?, down.map_or(Ok(0.0), at)?),
            (None, Some((from, speed))) => crate::sim::wind_from(at(from)?.to_radians(), at(speed)?),
            (None, None) => Vector3::zeros(),
        };
        if knots.last().is_some_and(|last| last.0 > t) {
            return Err(format!("line {}: time goes back", line + 1));
        }
        knots.push((t, wind));
    }
    if knots.is_empty() { Err("has no rows".into()) } else { Ok(knots) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_read() {
        let a = parse("t_boot_s,other,wind_n,wind_e\n1,x,2,3\n2.5,x,0,-1\n").unwrap();
        assert_eq!(a, [(1.0, Vector3::new(2.0, 3.0, 0.0)), (2.5, Vector3::new(0.0, -1.0, 0.0))]);
        let b = parse("wall_unix,boot_ms,wind_from_deg,speed_mps\n0,1500,90,4\n").unwrap();
        assert!((b[0].1 - Vector3::new(0.0, -4.0, 0.0)).norm() < 1e-9 && b[0].0 == 1.5);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        assert!(parse("a,b\n").unwrap_err().contains("no column `t_s`"));
        assert!(parse("t_s,wind_n,wind_e\n0,1,2\n1,x,2\n").unwrap_err().starts_with("line 3: `wind_n` holds `x`"));
        assert!(parse("t_s,wind_n,wind_e\n2,1,2\n1,1,2\n").unwrap_err().contains("time goes back"));
        assert!(parse("t_s,wind_n,wind_e\n").unwrap_err().contains("no rows"));
    }
}
