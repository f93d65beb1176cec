use super::model::{Linearised, Model};
use super::smooth::radii;
use crate::sets::Interval;
use crate::vehicle::GRAVITY_MPS2;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::ops::{Add, Mul, Neg, Sub};

/// States of [`Quadrotor`].
pub const STATES: usize = 12;
/// First index of each group of three states.
pub const POSITION: usize = 0;
pub const VELOCITY: usize = 3;
pub const ATTITUDE: usize = 6;
pub const RATE: usize = 9;

/// Pitch beyond this is too near to where Euler angles end, rad.
const STEEPEST_PITCH: f64 = 1.45;
/// Roundings along the longest chain of operations in this file, generously.
const ROUNDING: f64 = 128.0 * f64::EPSILON;

type State = SVector<f64, STATES>;
type Vector = Vector3<f64>;
type Box3 = [Interval; 3];

/// A rigid body with rotors: position (m, NED), velocity (m/s, NED), roll, pitch, yaw (rad), body rates (rad/s, FRD).
///
/// `ṗ = v`, `m·v̇ = m·g + R·(f + d_b) + d_w`, `Θ̇ = W(Θ)·ω`, `J·ω̇ = τ − ω×Jω − Dω + d_τ`, in continuous time. A step
/// holds the rotors' wrench (f, τ) at its mean; the disturbances d may be anything within their boxes at any time,
/// so they also hold what the true wrench departs from that mean, and whatever mass, inertia and rotor law leave open.
/// The gyroscopic torque of the rotors counts as disturbance too.
#[derive(Debug, Clone, PartialEq)]
pub struct Quadrotor {
    mass_kg: f64,
    inverse_inertia: Matrix3<f64>,
    damping: Vector,
    /// Symmetric forms: ω̇ = … − ωᵀBᵢω.
    gyration: [Matrix3<f64>; 3],
    /// Largest disturbance, world NED, N.
    force_ned_n: Vector,
    /// Largest disturbance along the body's axes, N, beside it.
    force_frd_n: Vector,
    /// Largest disturbance torque, N m.
    torque_frd_nm: Vector,
}

/// What the rotors do in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    pub dt_s: f64,
    /// Mean force of the rotors, body FRD, N.
    pub force_frd_n: Vector,
    /// Mean torque of the rotors, body FRD, N m.
    pub torque_frd_nm: Vector,
    /// Share by which these two may be wrong beside the declared disturbance.
    pub doubt: f64,
}

/// Why there is no such quadrotor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum QuadrotorError {
    #[error("the inertia has no inverse")]
    Inertia,
    #[error("the mass is not greater than zero")]
    Mass,
}

impl Quadrotor {
    /// `damping` in N m per rad/s; disturbances as half-widths in N (NED), N (FRD) and N m (FRD).
    ///
    /// # Errors
    /// [`QuadrotorError`] for a body that cannot be.
    pub fn new(
        mass_kg: f64,
        inertia_kgm2: &Matrix3<f64>,
        damping: Vector,
        force_ned_n: Vector,
        force_frd_n: Vector,
        torque_frd_nm: Vector,
    ) -> Result<Self, QuadrotorError> {
        if mass_kg.is_nan() || mass_kg <= 0.0 {
            return Err(QuadrotorError::Mass);
        }
        let inverse_inertia = inertia_kgm2.try_inverse().ok_or(QuadrotorError::Inertia)?;
        // (ω×Jω)ᵢ is a quadratic form in ω
        let form = |i: usize| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let m = Matrix3::from_fn(|a, b| {
                f64::from(a == j) * inertia_kgm2[(k, b)] - f64::from(a == k) * inertia_kgm2[(j, b)]
            });
            (m + m.transpose()) * 0.5
        };
        let forms = [form(0), form(1), form(2)];
        let gyration = std::array::from_fn(|i| {
            forms.iter().enumerate().fold(Matrix3::zeros(), |sum, (k, f)| sum + f * inverse_inertia[(i, k)])
        });
        Ok(Self { mass_kg, inverse_inertia, damping, gyration, force_ned_n, force_frd_n, torque_frd_nm })
    }

    /// Largest |ω̇| while |ω| ≤ `rate`.
    fn largest_acceleration(&self, drive: &Drive, torque: &Vector, rate: &Vector) -> Vector {
        let torque = drive.torque_frd_nm.abs() + torque + self.damping.component_mul(rate);
        self.inverse_inertia.abs() * torque + Vector::from_fn(|i, _| rate.dot(&(self.gyration[i].abs() * rate)))
    }

    /// Bounds of |ω| and |ω̇| over the whole step: with these the motion cannot have left the first (Picard).
    fn rates_in_step(&self, drive: &Drive, torque: &Vector, start: &Vector) -> Option<(Vector, Vector)> {
        let mut rate = *start;
        for _ in 0..12 {
            let acceleration = self.largest_acceleration(drive, torque, &rate) * (1.0 + ROUNDING);
            let reached = start + acceleration * (drive.dt_s * (1.0 + ROUNDING));
            if reached.iter().zip(rate.iter()).all(|(a, b)| a <= b) {
                return Some((rate, acceleration));
            }
            rate = reached * 1.05;
        }
        None
    }
}

/// Sine, cosine, tangent and secant of roll and pitch over a box.
#[derive(Debug, Clone, Copy)]
struct Tilt {
    sr: Interval,
    cr: Interval,
    tp: Interval,
    secp: Interval,
}

impl Tilt {
    /// `None` where pitch comes too near to the vertical.
    fn over(roll: Interval, pitch: Interval) -> Option<Self> {
        if pitch.mag() > STEEPEST_PITCH {
            return None;
        }
        let secp = pitch.cos().recip();
        Some(Self { sr: roll.sin(), cr: roll.cos(), tp: pitch.sin() * secp, secp })
    }
}

/// R = R_z(yaw)·R_y(pitch)·R_x(roll) applied to a vector: the three turns one after another, each as the turn itself
/// or its first or second derivative by the angle.
#[derive(Debug, Clone, Copy)]
struct Turn<S> {
    sin: [S; 3],
    cos: [S; 3],
    zero: S,
}

impl Turn<Interval> {
    fn over(angles: &Box3) -> Self {
        Self { sin: angles.map(Interval::sin), cos: angles.map(Interval::cos), zero: Interval::ZERO }
    }
}

impl Turn<f64> {
    fn at(angles: &[f64; 3]) -> Self {
        Self { sin: angles.map(f64::sin), cos: angles.map(f64::cos), zero: 0.0 }
    }
}

impl<S: Copy + Add<Output = S> + Sub<Output = S> + Mul<Output = S> + Neg<Output = S>> Turn<S> {
    /// `orders` says how often each of roll, pitch and yaw is differentiated.
    fn apply(&self, orders: [u8; 3], vector: &[S; 3]) -> [S; 3] {
        let mut v = *vector;
        for axis in 0..3 {
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            let (s, c) = (self.sin[axis], self.cos[axis]);
            let (s, c) = match orders[axis] {
                0 => (s, c),
                1 => (c, -s),
                _ => (-s, -c),
            };
            let (a, b) = (v[j], v[k]);
            v[j] = c * a - s * b;
            v[k] = s * a + c * b;
            if orders[axis] > 0 {
                v[axis] = self.zero;
            }
        }
        v
    }
}

fn mags(v: &Box3) -> Vector {
    Vector::from_fn(|i, _| v[i].mag())
}

fn about(radius: f64) -> Interval {
    Interval::centred(0.0, radius)
}

impl Model<STATES> for Quadrotor {
    type Input = Drive;

    fn linearise(&self, base: &State, hull: &[Interval; STATES], drive: &Drive) -> Option<Linearised<STATES>> {
        let t = drive.dt_s;
        let r = radii(base, hull);
        let group = |first: usize| -> Box3 { std::array::from_fn(|i| hull[first + i]) };
        let (angles, rates) = (group(ATTITUDE), group(RATE));
        let torque = self.torque_frd_nm + drive.torque_frd_nm.abs() * drive.doubt;
        let body = self.force_frd_n + drive.force_frd_n.abs() * drive.doubt;

        // where rates and angles may be at any time of the step
        let (rate, acceleration) = self.rates_in_step(drive, &torque, &mags(&rates))?;
        let pitch_speed = rate.y.hypot(rate.z);
        let pitch = angles[1] + about(t * pitch_speed);
        let steep = Tilt::over(angles[0], pitch)?;
        let roll_speed = rate.x + pitch_speed * steep.tp.mag();
        let yaw_speed = pitch_speed * steep.secp.mag();
        let in_step: Box3 = [angles[0] + about(t * roll_speed), pitch, angles[2] + about(t * yaw_speed)];
        let rates_in_step: Box3 = std::array::from_fn(|i| rates[i] + about(t * acceleration[i]));

        let mut form = Linearised {
            value: *base,
            jacobian: SMatrix::identity(),
            disturbance: State::zeros(),
            remainder: State::zeros(),
        };
        self.spin(base, &r, drive, &torque, &rate, &acceleration, &mut form);
        let tilt = Tilt::over(angles[0], angles[1])?;
        turn(base, &r, t, &tilt, &rates, &mut form);
        let spinning = self.accelerations(drive, &torque, &rate);
        bend(t, &Tilt::over(in_step[0], pitch)?, &rates_in_step, &spinning, &mut form);
        self.fly(base, &r, drive, &body, &angles, &in_step, &rates_in_step, &mut form);

        // value and Jacobian are computed in floating point
        let rounding = (form.value.abs() + base.abs() + form.jacobian.abs() * r) * ROUNDING;
        let scale = Vector::repeat(t * (GRAVITY_MPS2 + drive.force_frd_n.norm() / self.mass_kg)) * (4.0 * ROUNDING);
        for i in 0..3 {
            form.remainder[VELOCITY + i] += scale[i];
            form.remainder[POSITION + i] += t * (scale[i] + base[VELOCITY + i].abs() * ROUNDING);
            form.remainder[ATTITUDE + i] += t * (rate.sum() * steep.secp.mag() * 4.0) * ROUNDING;
            form.remainder[RATE + i] += t * acceleration.amax() * 4.0 * ROUNDING;
        }
        form.remainder = (form.remainder + rounding) * (1.0 + ROUNDING);
        form.disturbance *= 1.0 + ROUNDING;
        form.value.iter().chain(form.remainder.iter()).all(|x| x.is_finite()).then_some(form)
    }
}

impl Quadrotor {
    /// ω̇ over the step: the rotors' share is known, the rest is bounded.
    fn accelerations(&self, drive: &Drive, torque: &Vector, rate: &Vector) -> Box3 {
        let known = self.inverse_inertia * drive.torque_frd_nm;
        let quiet = Drive { torque_frd_nm: Vector::zeros(), ..*drive };
        let rest = self.largest_acceleration(&quiet, torque, rate);
        std::array::from_fn(|i| Interval::centred(known[i], rest[i] * (1.0 + ROUNDING)))
    }

    /// Body rates: a quadratic map, so its second-order form is exact; what remains is the change of ω̇ in the step.
    #[allow(clippy::too_many_arguments)]
    fn spin(
        &self,
        base: &State,
        r: &State,
        drive: &Drive,
        torque: &Vector,
        rate: &Vector,
        acceleration: &Vector,
        form: &mut Linearised<STATES>,
    ) {
        let t = drive.dt_s;
        let w: Vector = base.fixed_rows::<3>(RATE).into_owned();
        let rw: Vector = r.fixed_rows::<3>(RATE).into_owned();
        let known = self.inverse_inertia * (drive.torque_frd_nm - self.damping.component_mul(&w));
        let unknown = self.inverse_inertia.abs() * torque;
        let damped = self.inverse_inertia.abs() * self.damping.component_mul(acceleration);
        for i in 0..3 {
            let b = &self.gyration[i];
            form.value[RATE + i] += t * (known[i] - w.dot(&(b * w)));
            let slope = b * w * 2.0;
            for k in 0..3 {
                form.jacobian[(RATE + i, RATE + k)] -= t * (slope[k] + self.inverse_inertia[(i, k)] * self.damping[k]);
            }
            form.disturbance[RATE + i] += t * unknown[i];
            let curved = rw.dot(&(b.abs() * rw));
            let changing = 2.0 * rate.dot(&(b.abs() * acceleration)) + damped[i];
            form.remainder[RATE + i] += t * curved + 0.5 * t * t * changing;
        }
    }

    /// Velocity and position.
    #[allow(clippy::too_many_arguments)]
    fn fly(
        &self,
        base: &State,
        r: &State,
        drive: &Drive,
        body: &Vector,
        angles: &Box3,
        in_step: &Box3,
        rates: &Box3,
        form: &mut Linearised<STATES>,
    ) {
        let t = drive.dt_s;
        let f: Vector = drive.force_frd_n / self.mass_kg;
        let force: Box3 = std::array::from_fn(|i| Interval::point(f[i]));
        let here = Turn::at(&std::array::from_fn(|i| base[ATTITUDE + i]));
        let over = Turn::over(angles);
        let pushed = here.apply([0; 3], &f.into());
        // the direction of the force changes in the step: R(ω×f)
        let cross: Box3 = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            rates[j] * f[k] - rates[k] * f[j]
        });
        let moving = Turn::over(in_step);
        let turning = moving.apply([0; 3], &cross);
        // |R| of the body's disturbance
        let one = |axis: usize| std::array::from_fn(|k| if k == axis { Interval::point(1.0) } else { Interval::ZERO });
        let mut drift = self.force_ned_n;
        for axis in (0..3).filter(|axis| body[*axis] > 0.0) {
            drift += mags(&moving.apply([0; 3], &one(axis))) * body[axis];
        }
        drift /= self.mass_kg;

        let slopes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(|orders| here.apply(orders, &f.into()));
        let mut curved = Vector::zeros();
        for i in 0..3 {
            for j in i..3 {
                let mut orders = [0; 3];
                orders[i] += 1;
                orders[j] += 1;
                let share = if i == j { 0.5 } else { 1.0 } * r[ATTITUDE + i] * r[ATTITUDE + j];
                curved += mags(&over.apply(orders, &force)) * share;
            }
        }
        for i in 0..3 {
            let gravity = if i == 2 { GRAVITY_MPS2 } else { 0.0 };
            let acceleration = pushed[i] + gravity;
            let (v, p) = (VELOCITY + i, POSITION + i);
            form.value[v] += t * acceleration + 0.5 * t * t * turning[i].mid();
            form.value[p] += t * base[v] + 0.5 * t * t * acceleration;
            form.jacobian[(p, v)] = t;
            for (k, slope) in slopes.iter().enumerate() {
                form.jacobian[(v, ATTITUDE + k)] = t * slope[i];
                form.jacobian[(p, ATTITUDE + k)] = 0.5 * t * t * slope[i];
            }
            form.disturbance[v] += t * drift[i];
            form.disturbance[p] += 0.5 * t * t * drift[i];
            form.remainder[v] += t * curved[i] + 0.5 * t * t * turning[i].radius();
            form.remainder[p] += 0.5 * t * t * curved[i] + t * t * t / 6.0 * turning[i].mag();
        }
    }
}

/// Euler angles over a step of constant W(Θ)ω, and the curvature of that map over the box.
fn turn(base: &State, r: &State, t: f64, tilt: &Tilt, rates: &Box3, form: &mut Linearised<STATES>) {
    let (sr, cr) = base[ATTITUDE].sin_cos();
    let (sp, cp) = base[ATTITUDE + 1].sin_cos();
    let (tp, secp) = (sp / cp, 1.0 / cp);
    let [p, q, w] = [base[RATE], base[RATE + 1], base[RATE + 2]];
    let (across, along) = (q * sr + w * cr, q * cr - w * sr);
    let values = [p + across * tp, along, across * secp];
    let by_roll = [along * tp, -across, along * secp];
    let by_pitch = [across * secp * secp, 0.0, across * tp * secp];
    let by_q = [sr * tp, cr, sr * secp];
    let by_r = [cr * tp, -sr, cr * secp];
    for i in 0..3 {
        let row = ATTITUDE + i;
        form.value[row] += t * values[i];
        form.jacobian[(row, ATTITUDE)] += t * by_roll[i];
        form.jacobian[(row, ATTITUDE + 1)] += t * by_pitch[i];
        form.jacobian[(row, RATE + 1)] += t * by_q[i];
        form.jacobian[(row, RATE + 2)] += t * by_r[i];
    }
    form.jacobian[(ATTITUDE, RATE)] += t;

    // second derivatives over the box
    let across = (rates[1] * tilt.sr + rates[2] * tilt.cr).mag();
    let along = (rates[1] * tilt.cr - rates[2] * tilt.sr).mag();
    let (sr, cr, tp, secp) = (tilt.sr.mag(), tilt.cr.mag(), tilt.tp.mag(), tilt.secp.mag());
    let (rr, rp) = (r[ATTITUDE], r[ATTITUDE + 1]);
    let (rq, rw) = (r[RATE + 1], r[RATE + 2]);
    let sec2 = secp * secp;
    let turned = cr * rq + sr * rw;
    let crossed = sr * rq + cr * rw;
    let curved = [
        0.5 * across * tp * rr * rr
            + along * sec2 * rr * rp
            + across * sec2 * tp * rp * rp
            + tp * rr * turned
            + sec2 * rp * crossed,
        0.5 * along * rr * rr + rr * crossed,
        0.5 * across * secp * rr * rr
            + along * secp * tp * rr * rp
            + 0.5 * across * secp * (sec2 + tp * tp) * rp * rp
            + secp * rr * turned
            + secp * tp * rp * crossed,
    ];
    for (i, curved) in curved.into_iter().enumerate() {
        form.remainder[ATTITUDE + i] += t * curved;
    }
}

/// What Euler angles gain because W(Θ)ω changes in the step: ½t²·d(Wω)/dt, whose middle is known.
fn bend(t: f64, tilt: &Tilt, rates: &Box3, accelerations: &Box3, form: &mut Linearised<STATES>) {
    let across = rates[1] * tilt.sr + rates[2] * tilt.cr;
    let pitching = rates[1] * tilt.cr - rates[2] * tilt.sr;
    let rolling = rates[0] + across * tilt.tp;
    let gathering = accelerations[1] * tilt.sr + accelerations[2] * tilt.cr + pitching * rolling;
    let second = [
        accelerations[0] + gathering * tilt.tp + across * tilt.secp.sqr() * pitching,
        accelerations[1] * tilt.cr - accelerations[2] * tilt.sr - across * rolling,
        gathering * tilt.secp + across * pitching * tilt.tp * tilt.secp,
    ];
    for (i, second) in second.into_iter().enumerate() {
        form.value[ATTITUDE + i] += 0.5 * t * t * second.mid();
        form.remainder[ATTITUDE + i] += 0.5 * t * t * second.radius();
    }
}
