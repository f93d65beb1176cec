use super::model::{Model, Output};
use crate::sets::{AxisStrip, Interval, Overlap, Reduction, Zonotope};
use nalgebra::SVector;

/// What the intervals promise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Algorithm 1 as published: no remainder of the linearisation, which is taken about the centre before the
    /// measurement. Its intervals may miss the truth.
    Paper,
    /// The remainder is bounded over the current box: the truth stays inside while noise and disturbance keep to
    /// their bounds.
    Guaranteed,
}

/// How a filter runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings<const N: usize> {
    pub mode: Mode,
    pub reduction: Reduction,
    /// Columns kept, in multiples of N.
    pub order: usize,
    /// Inverse of each state's typical size: what makes columns of mixed units comparable.
    pub weights: SVector<f64, N>,
}

/// The zonotopic extended Kalman filter (Wang and Puig, Algorithms 1 and 2) for any [`Model`], with room for M
/// generators. Allocates nothing.
///
/// One step is [`Self::predict`] to the instant of the measurement, then [`Self::correct`]. The outputs are taken one
/// after another with the optimal gain (7) of each: with independent noises the result is that of one gain for all,
/// and an output that contradicts the set can be left out.
#[derive(Debug, Clone)]
pub struct ZonotopicFilter<const N: usize, const M: usize> {
    settings: FilterSettings<N>,
    /// The set, and room for the next one: which is which changes with every step, as copying them takes its time.
    sets: [Zonotope<N, M>; 2],
    current: usize,
    /// Centre before the last correction: where the paper linearises.
    prior: SVector<f64, N>,
}

/// The prediction could not be bounded: see [`Model::linearise`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the model cannot be bounded over the current set; start anew from a smaller box")]
pub struct Unbounded;

impl<const N: usize, const M: usize> ZonotopicFilter<N, M> {
    /// Knows of the state that it lies in a box.
    pub fn new(initial: &[Interval; N], settings: FilterSettings<N>) -> Self {
        let set = Zonotope::from_box(initial);
        Self { settings, prior: *set.centre(), sets: [set.clone(), set], current: 0 }
    }

    /// Starts anew from a box.
    pub fn restart(&mut self, initial: &[Interval; N]) {
        self.set_mut().set_box(initial);
        self.prior = *self.set().centre();
    }

    pub fn set(&self) -> &Zonotope<N, M> {
        &self.sets[self.current]
    }

    fn set_mut(&mut self) -> &mut Zonotope<N, M> {
        &mut self.sets[self.current]
    }

    /// The set becomes what `make` writes over the room for the next one.
    fn replace(&mut self, make: impl FnOnce(&Zonotope<N, M>, &mut Zonotope<N, M>)) {
        let [a, b] = &mut self.sets;
        if self.current == 0 {
            make(a, b)
        } else {
            make(b, a)
        }
        self.current = 1 - self.current;
    }

    /// Interval of every state.
    pub fn hull(&self) -> [Interval; N] {
        self.set().interval_hull()
    }

    /// Carries the set over one step of the model: (6) without its gain, which [`Self::correct`] has applied.
    ///
    /// # Errors
    /// [`Unbounded`] when the model gives no linear form over the current hull; the set stays as it was.
    pub fn predict<S: Model<N>>(&mut self, model: &S, input: &S::Input) -> Result<(), Unbounded> {
        let settings = self.settings;
        let base = match settings.mode {
            Mode::Paper => self.prior,
            Mode::Guaranteed => *self.set().centre(),
        };
        let form = model.linearise(&base, &self.hull(), input).ok_or(Unbounded)?;
        self.set_mut().spread();
        self.replace(|set, next| set.map_into(&form.jacobian, next));
        let set = self.set_mut();
        // A·(c − b) + f(b): the map has brought A·c
        let moved = form.jacobian * base;
        set.translate(&(form.value - moved));
        set.add_box(&form.disturbance);
        if settings.mode == Mode::Guaranteed {
            let size = form.value.abs() + form.jacobian.abs() * base.abs();
            set.add_box(&(form.remainder + size * ((N + 2) as f64 * f64::EPSILON)));
        }
        set.reduce(settings.reduction, settings.order, &settings.weights);
        self.prior = *self.set().centre();
        Ok(())
    }

    /// Tells how each output lies to the predicted set, (8)–(11) and Algorithm 2, then takes in those that agree with
    /// it. What disagrees is left out: the set stays what it was without that output.
    ///
    /// `told` receives one [`Overlap`] for each output, in their order, as far as it is long. Outputs that measure a
    /// state are taken in first and all at once, the others one after another.
    pub fn correct(&mut self, outputs: &[Output<N>], told: &mut [Overlap]) {
        self.set_mut().spread();
        let mut strips = [AxisStrip { axis: 0, offset: 0.0, half_width: 0.0 }; N];
        let mut places = [0; N];
        let mut n = 0;
        for (k, (output, told)) in outputs.iter().zip(told.iter_mut()).enumerate() {
            match (output.state, strips.get_mut(n)) {
                (Some(axis), Some(strip)) => {
                    *strip = AxisStrip { axis, offset: output.strip.offset, half_width: output.strip.half_width };
                    places[n] = k;
                    n += 1;
                }
                _ => *told = self.set().overlap(&output.strip),
            }
        }
        if n > 0 {
            let mut met = [Overlap::default(); N];
            self.replace(|set, next| set.intersect_axes_into(&strips[..n], &mut met, next));
            for (place, met) in places.iter().zip(met).take(n) {
                told[*place] = met;
            }
        }
        for (k, (output, told)) in outputs.iter().zip(told.iter_mut()).enumerate() {
            if !places[..n].contains(&k) && told.touches() && self.set_mut().intersect_strip(&output.strip).is_none() {
                // jointly with the outputs before it, it contradicts the set where alone it does not
                *told = self.set().overlap(&output.strip);
            }
        }
    }

    /// Widens one state so that the set also holds every value of `range` for it.
    pub fn widen(&mut self, state: usize, range: Interval) {
        let set = self.set_mut();
        let Some(&centre) = set.centre().get(state) else { return };
        let reach = (range.hi() - centre).max(centre - range.lo());
        let missing = reach - set.radius(state);
        if missing > 0.0 {
            let mut extra = SVector::zeros();
            extra[state] = missing.next_up();
            set.add_box(&extra);
        }
    }
}
