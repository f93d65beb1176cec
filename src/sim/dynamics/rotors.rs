use crate::signal::MAX_ROTORS;

/// What is wrong with one rotor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RotorHealth {
    Good,
    /// A weak motor: it reaches only this share of the thrust asked, and its speed shows it. 0 is a lost rotor.
    Weak(f64),
    /// A damaged propeller: this share of the thrust at full speed, so the measured speed shows nothing.
    Damaged(f64),
    /// Stuck at this command, whatever is asked.
    Stuck(f64),
}

impl RotorHealth {
    /// Share of the healthy thrust at the same command.
    pub(super) fn thrust_share(self) -> f64 {
        match self {
            Self::Weak(share) | Self::Damaged(share) => share,
            Self::Good | Self::Stuck(_) => 1.0,
        }
    }

    /// Share of the healthy speed at the same command; thrust goes with its square.
    pub(super) fn speed_share(self) -> f64 {
        match self {
            Self::Weak(share) => share.max(0.0).sqrt(),
            Self::Good | Self::Damaged(_) | Self::Stuck(_) => 1.0,
        }
    }
}

/// First-order lag of all rotors over one step under a held command, solved exactly: x(t) = c + (x₀ − c)e^(−t/τ).
#[derive(Debug, Clone, Copy)]
pub(super) struct Lag {
    half: f64,
    full: f64,
    /// 1/τ; 0 when the rotor follows at once and its acceleration has no meaning.
    rate: f64,
}

impl Lag {
    pub fn new(time_constant_s: f64, step_s: f64) -> Self {
        if time_constant_s <= 0.0 {
            return Self { half: 0.0, full: 0.0, rate: 0.0 };
        }
        let half = (-0.5 * step_s / time_constant_s).exp();
        Self { half, full: half * half, rate: 1.0 / time_constant_s }
    }

    /// Rotor states at the step's start, middle and end, each with its rate of change, 1/s.
    pub fn over_step(&self, start: &[f64; MAX_ROTORS], command: &[f64; MAX_ROTORS], out: &mut [RotorStates; 3]) {
        for (s, decay) in out.iter_mut().zip([1.0, self.half, self.full]) {
            for i in 0..MAX_ROTORS {
                let away = (start[i] - command[i]) * decay;
                s.level[i] = command[i] + away;
                s.rate[i] = -away * self.rate;
            }
        }
    }

    /// Moves rotors to the end of a step.
    pub fn finish_step(&self, state: &mut [f64; MAX_ROTORS], command: &[f64; MAX_ROTORS]) {
        for (x, c) in state.iter_mut().zip(command) {
            *x = c + (*x - c) * self.full;
        }
    }

    /// Rate (1/s) at which a rotor at `level` moves towards its command.
    pub fn rate_towards(&self, command: f64, level: f64) -> f64 {
        (command - level) * self.rate
    }

    /// With no lag the rotor is at its command from the first instant of the step.
    pub fn begin(&self, state: &mut [f64; MAX_ROTORS], command: &[f64; MAX_ROTORS]) {
        if self.rate == 0.0 {
            *state = *command;
        }
    }
}

/// Effective commands (0..1) and their rates.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RotorStates {
    pub level: [f64; MAX_ROTORS],
    pub rate: [f64; MAX_ROTORS],
}
