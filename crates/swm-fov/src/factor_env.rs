//! The frame of an environment with factors: its description, the order of a reset, images, saved states, looks.

use std::collections::BTreeMap;

use swm_core::env::{Episode, Keypoint, PIXELS};
use swm_core::{
    Env, EnvConfig, EnvError, EnvSpec, EnvState, EpisodeSeed, Outcome, ResetOptions, RowsMut, Slice,
    SlotView, Value,
};

use crate::assignment::{Fov, SavedFov};
use crate::factor::FovSpace;
use crate::scene::{Scene, SceneError};

/// The environment of a [`Scene`].
pub struct FactorEnv<S: Scene> {
    spec: EnvSpec,
    /// Index of the first factor among the fields.
    first_factor: usize,
    settings: S::Settings,
    space: FovSpace,
    fov: Fov,
    scene: S,
    state: S::State,
    image: Option<Image<S::Canvas>>,
    /// Values of visual factors that images show in place of those of the episode.
    look: BTreeMap<String, Value>,
}

/// What images need.
struct Image<C> {
    canvas: C,
    /// `[H, W, 3]`: the image of the goal; empty where there is none.
    goal: Vec<u8>,
    /// The goal image belongs to an earlier episode.
    goal_is_stale: bool,
}

impl<S: Scene> FactorEnv<S> {
    /// Makes the environment.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: an unknown or misfit setting or default of a factor, or an image size that cannot be
    /// rendered.
    pub fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        let wrong = wrong_setting::<S>;
        let settings = S::settings(config)?;
        let space = S::factors(&settings).map_err(wrong)?;
        let fov = space.defaults();
        let image = config.image.map(|size| {
            let bytes = if S::HAS_GOAL_IMAGE { size.shape().iter().product() } else { 0 };
            Ok(Image { canvas: S::canvas(&settings, size)?, goal: vec![0; bytes], goal_is_stale: true })
        });
        let image = image.transpose().map_err(wrong)?;
        let mut spec = S::spec().factors(space.specs());
        let first_factor = spec.fields.len();
        spec.fields.extend(space.fields());
        match config.image {
            Some(size) if S::HAS_GOAL_IMAGE => spec.fields.extend(size.fields_with_goal()),
            size => spec.fields.extend(size.map(|size| size.field(PIXELS))),
        }
        let mut scene = S::new(&settings, &fov).map_err(wrong)?;
        let options = ResetOptions::default();
        let state = scene.start(&spec, &fov, &Episode::new(EpisodeSeed::new(0), &options)).map_err(wrong)?;
        scene.take_goal(&state);
        let look = BTreeMap::new();
        let mut env = Self { spec, first_factor, settings, space, fov, scene, state, image, look };
        env.refresh()?;
        Ok(env)
    }

    /// Makes the environment, for [`swm_core::EnvEntry::new`].
    ///
    /// # Errors
    ///
    /// As of [`FactorEnv::new`].
    pub fn boxed(config: &EnvConfig) -> Result<Box<dyn Env>, EnvError> {
        Ok(Box::new(Self::new(config)?))
    }

    /// The factor table of an environment of this configuration, for [`FactorEnv::episode`].
    ///
    /// # Errors
    ///
    /// As of [`FactorEnv::new`].
    pub fn factors(config: &EnvConfig) -> Result<FovSpace, EnvError> {
        S::factors(&S::settings(config)?).map_err(wrong_setting::<S>)
    }

    /// Factors and state of the episode that a policy sees: for experts, which know the world.
    ///
    /// # Errors
    ///
    /// As of [`SlotView::snapshot`], or the environment has other factors.
    pub fn episode(space: &FovSpace, view: &SlotView<'_>) -> Result<(Fov, S::State), EnvError> {
        let mut saved = EnvState::new();
        view.snapshot(&mut saved)?;
        Self::load(space, &saved)
    }

    fn load(space: &FovSpace, saved: &EnvState) -> Result<(Fov, S::State), EnvError> {
        let (fov, state): (SavedFov, S::State) = saved.load(S::ID)?;
        let foreign = |reason: String| EnvError::State { env: S::ID.to_owned(), reason };
        Ok((space.recall(&fov).map_err(|error| foreign(error.to_string()))?, state))
    }

    /// What the factors of the episode determine.
    pub fn scene(&self) -> &S {
        &self.scene
    }

    /// What changes in the episode.
    pub fn state(&self) -> &S::State {
        &self.state
    }

    /// Scene and state, for tests that place things.
    pub fn parts_mut(&mut self) -> (&mut S, &mut S::State) {
        (&mut self.scene, &mut self.state)
    }

    /// Takes over what images show of an episode.
    fn refresh(&mut self) -> Result<(), EnvError> {
        let Some(image) = &mut self.image else { return Ok(()) };
        image.goal_is_stale = true;
        let dressed = match self.look.is_empty() {
            true => None,
            false => Some(self.space.dressed(S::ID, &self.fov, &self.look)?),
        };
        let look = dressed.as_ref().unwrap_or(&self.fov);
        self.scene.dress(&self.state, look, &mut image.canvas).map_err(wrong_reset::<S>)
    }
}

fn wrong_setting<S: Scene>(error: SceneError) -> EnvError {
    error.of::<S>(|env, reason| EnvError::Setting { env, reason })
}

fn wrong_reset<S: Scene>(error: SceneError) -> EnvError {
    error.of::<S>(|env, reason| EnvError::Reset { env, reason })
}

impl<S: Scene> Env for FactorEnv<S> {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        let wrong = wrong_reset::<S>;
        self.fov = S::sample(&self.space, episode).map_err(wrong)?;
        self.scene = S::new(&self.settings, &self.fov).map_err(wrong)?;
        self.state = self.scene.start(&self.spec, &self.fov, episode).map_err(wrong)?;
        self.scene.take_goal(&self.state);
        self.refresh()?;
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.scene.outcome(&self.state) })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let stepped = self.scene.step(&mut self.state, action);
        stepped.map_err(|error| error.of::<S>(|env, reason| EnvError::Diverged { env, reason }))
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        self.scene.write_episode(&self.state, out);
        self.fov.write(self.first_factor, out);
        let Some(image) = self.image.as_mut().filter(|_| S::HAS_GOAL_IMAGE) else { return };
        if image.goal_is_stale {
            self.scene.render_goal(&self.state, &mut image.canvas, &mut image.goal);
            image.goal_is_stale = false;
        }
        out.write(self.spec.fields.len() - 1, &image.goal);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        self.scene.observe(&self.state, out);
        if let Some(image) = &mut self.image {
            let field = self.spec.fields.len() - 1 - usize::from(S::HAS_GOAL_IMAGE);
            self.scene.render(&self.state, &mut image.canvas, out.at(field));
        }
    }

    fn snapshot(&self, saved: &mut EnvState) -> Result<(), EnvError> {
        saved.store(S::ID, &(self.fov.save(), &self.state))
    }

    fn restore(&mut self, saved: &EnvState) -> Result<(), EnvError> {
        let wrong = |error: SceneError| error.of::<S>(|env, reason| EnvError::State { env, reason });
        let (fov, state) = Self::load(&self.space, saved)?;
        // Planners return to states of one episode again and again: what does not change in it stays.
        let has_new_factors = fov != self.fov;
        if has_new_factors {
            let mut scene = S::new(&self.settings, &fov).map_err(wrong)?;
            scene.restore(&state).map_err(wrong)?;
            (self.fov, self.scene) = (fov, scene);
        } else {
            self.scene.restore(&state).map_err(wrong)?;
        }
        let is_same_episode = !has_new_factors && S::is_same_goal(&state, &self.state);
        self.state = state;
        if is_same_episode {
            return Ok(());
        }
        self.scene.take_goal(&self.state);
        self.refresh()
    }

    fn dress(&mut self, look: &BTreeMap<String, Value>) -> Result<(), EnvError> {
        if !self.spec.factors.iter().any(|factor| factor.visual) {
            return swm_core::env::refuse_look(&self.spec, look);
        }
        self.space.dressed(S::ID, &self.fov, look)?;
        if *look != self.look {
            self.look.clone_from(look);
            self.refresh()?;
        }
        Ok(())
    }

    fn is_truncated(&self) -> bool {
        self.scene.is_truncated(&self.state)
    }

    fn task_cost(&self) -> Option<f64> {
        self.scene.task_cost(&self.state)
    }

    fn keypoints(&self) -> Vec<Keypoint> {
        self.scene.keypoints(&self.state)
    }
}
