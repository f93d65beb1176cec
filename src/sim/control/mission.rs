use super::shaper::Shaper;
use super::{Navigation, Reference};
use nalgebra::Vector3;
use std::collections::VecDeque;

/// One part of a mission. Positions are relative to the take-off point, NED.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leg {
    /// On the ground, motors off.
    Wait { seconds: f64 },
    /// Arms, then climbs straight up.
    Takeoff { height_m: f64 },
    /// Holds the point reached.
    Hover { seconds: f64 },
    /// Flies to a point and stops there.
    Goto { position_ned_m: Vector3<f64>, speed_mps: f64 },
    /// Flies with a velocity.
    Velocity { velocity_ned_mps: Vector3<f64>, seconds: f64 },
    /// Flies a level circle that begins northwards and bends to the right, nose ahead or held.
    Circle { radius_m: f64, speed_mps: f64, seconds: f64, nose_ahead: bool },
    /// Turns the nose, east of north.
    Turn { heading_rad: f64 },
    /// Descends and disarms on the ground.
    Land,
}

/// What the autopilot is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flight {
    Disarmed,
    TakingOff,
    Flying,
    Landing,
}

impl Flight {
    pub fn armed(self) -> bool {
        self != Self::Disarmed
    }
}

/// Time from arming to leaving the ground, s.
const SPOOL_S: f64 = 2.0;
/// Lift below this share of the weight, at rest, means that the ground carries the vehicle.
const LANDED_LIFT: f64 = 0.6;
const LANDED_FOR_S: f64 = 0.8;
/// Leaning this far for this long is a crash, rad and s.
const CRASH_TILT: f64 = 1.4;
const CRASHED_FOR_S: f64 = 1.0;

/// Flies legs one after the other.
#[derive(Debug, Clone)]
pub struct Pilot {
    legs: VecDeque<Leg>,
    flight: Flight,
    /// Time in this leg, s.
    elapsed_s: f64,
    shaper: Shaper,
    acceleration_limit: f64,
    /// Believed position at take-off.
    home: Vector3<f64>,
    heading_rad: f64,
    landed_for_s: f64,
    tilted_for_s: f64,
}

impl Pilot {
    /// With a mission; an empty one waits on the ground for [`Self::order`].
    pub fn new(legs: impl IntoIterator<Item = Leg>, acceleration_limit_mps2: f64) -> Self {
        Self {
            legs: legs.into_iter().collect(),
            flight: Flight::Disarmed,
            elapsed_s: 0.0,
            shaper: Shaper::at(Vector3::zeros(), 0.0, acceleration_limit_mps2),
            acceleration_limit: acceleration_limit_mps2,
            home: Vector3::zeros(),
            heading_rad: 0.0,
            landed_for_s: 0.0,
            tilted_for_s: 0.0,
        }
    }

    pub fn flight(&self) -> Flight {
        self.flight
    }

    /// True when every leg has been flown.
    pub fn done(&self) -> bool {
        self.legs.is_empty()
    }

    /// Drops what is left of the mission for these legs.
    pub fn order(&mut self, legs: impl IntoIterator<Item = Leg>) {
        self.legs.clear();
        self.legs.extend(legs);
        self.elapsed_s = 0.0;
    }

    /// Arms on the ground without taking off.
    pub fn arm(&mut self, now: &Navigation) {
        if self.flight == Flight::Disarmed {
            self.begin(now);
        }
    }

    /// Stops the motors at once.
    pub fn disarm(&mut self) {
        self.flight = Flight::Disarmed;
        self.legs.clear();
    }

    /// True while the ground may carry the vehicle, so that no loop should learn from what it feels.
    pub fn near_ground(&self, now: &Navigation) -> bool {
        !matches!(self.flight, Flight::Flying | Flight::Landing) && self.home.z - now.position_ned_m.z < 0.3
    }

    /// One loop: the reference to fly, or `None` while the motors stand still. `lift_share` is the lift asked for
    /// last over the weight.
    pub fn update(&mut self, now: &Navigation, lift_share: f64, dt: f64) -> Option<Reference> {
        self.elapsed_s += dt;
        self.watch_for_crash(now, dt);
        match self.legs.front().copied() {
            Some(leg) => {
                if self.fly(leg, now, lift_share, dt) {
                    self.legs.pop_front();
                    self.elapsed_s = 0.0;
                }
            }
            None => self.hold(dt),
        }
        self.shaper.turn(self.heading_rad, dt);
        self.flight.armed().then(|| self.shaper.reference())
    }

    /// One loop of a leg; true when it is complete.
    fn fly(&mut self, leg: Leg, now: &Navigation, lift_share: f64, dt: f64) -> bool {
        match leg {
            Leg::Wait { seconds } => self.elapsed_s >= seconds,
            Leg::Takeoff { height_m } => {
                if self.flight == Flight::Disarmed {
                    self.begin(now);
                }
                if self.elapsed_s < SPOOL_S {
                    return false;
                }
                let top = Vector3::new(self.shaper.position.x, self.shaper.position.y, self.home.z - height_m);
                self.shaper.towards(top, 2.5, dt);
                let there = (self.shaper.position - top).norm() < 0.02
                    && (now.position_ned_m.z - top.z).abs() < 0.5
                    && now.velocity_ned_mps.z.abs() < 0.3;
                if there {
                    self.flight = Flight::Flying;
                }
                there
            }
            Leg::Hover { seconds } => {
                self.hold(dt);
                self.elapsed_s >= seconds
            }
            Leg::Goto { position_ned_m, speed_mps } => {
                let target = self.home + position_ned_m;
                self.shaper.towards(target, speed_mps, dt);
                (self.shaper.position - target).norm() < 0.05 && (now.position_ned_m - target).norm() < 1.0
            }
            Leg::Velocity { velocity_ned_mps, seconds } => {
                self.shaper.with_velocity(velocity_ned_mps, dt);
                self.elapsed_s >= seconds
            }
            Leg::Circle { radius_m, speed_mps, seconds, nose_ahead } => {
                let angle = speed_mps / radius_m * self.elapsed_s;
                self.shaper.with_velocity(Vector3::new(angle.cos(), angle.sin(), 0.0) * speed_mps, dt);
                if nose_ahead {
                    self.heading_rad = angle;
                }
                self.elapsed_s >= seconds
            }
            Leg::Turn { heading_rad } => {
                self.heading_rad = heading_rad;
                self.hold(dt);
                super::shaper::wrap(heading_rad - self.shaper.yaw_rad).abs() < 0.02
            }
            Leg::Land => self.land(now, lift_share, dt),
        }
    }

    fn begin(&mut self, now: &Navigation) {
        self.flight = Flight::TakingOff;
        self.home = now.position_ned_m;
        self.heading_rad = now.body_to_ned.euler_angles().2;
        self.shaper = Shaper::at(now.position_ned_m, self.heading_rad, self.acceleration_limit);
        self.elapsed_s = 0.0;
        self.landed_for_s = 0.0;
    }

    fn hold(&mut self, dt: f64) {
        self.shaper.with_velocity(Vector3::zeros(), dt);
    }

    fn land(&mut self, now: &Navigation, lift_share: f64, dt: f64) -> bool {
        if self.flight == Flight::Disarmed {
            return true;
        }
        self.flight = Flight::Landing;
        let height = self.home.z - self.shaper.position.z;
        let sink = if height > 6.0 { 1.5 } else { 0.5 };
        self.shaper.with_velocity(Vector3::z() * sink, dt);
        let resting = lift_share < LANDED_LIFT && now.velocity_ned_mps.z.abs() < 0.3;
        self.landed_for_s = if resting { self.landed_for_s + dt } else { 0.0 };
        if self.landed_for_s >= LANDED_FOR_S {
            self.flight = Flight::Disarmed;
        }
        self.flight == Flight::Disarmed
    }

    fn watch_for_crash(&mut self, now: &Navigation, dt: f64) {
        let up = -(now.body_to_ned * -Vector3::z()).z;
        let tilted = self.flight.armed() && up < CRASH_TILT.cos();
        self.tilted_for_s = if tilted { self.tilted_for_s + dt } else { 0.0 };
        if self.tilted_for_s >= CRASHED_FOR_S {
            self.disarm();
        }
    }
}
