//! `World`: many environments, stepped from Python. The class of the package (`world/world.py`) is built on this one.

use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, TryLockError};

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use swm::core::{
    Batch, EnvConfig, EnvEntry, EnvSpec, EnvState, EpisodeSeed, FactorSpec, ImageSize, LiveEpisode, Policy,
    Registry, ResetOptions, SavedSlot, SuccessRule, World, WorldError, WorldOptions,
};
use swm::tasks::request::{Message, model_image, note_elites, note_images, policy_args};

use crate::errors::{OrRaise as _, SwmError};
use crate::fork::Process;
use crate::infos;
use crate::integers;
use crate::memory::views::{self, Table};
use crate::mirror::{Mirror, SavedRow};
use crate::policy::Foreign;

/// Every environment, policy, solver and format of the package.
pub(crate) fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> = LazyLock::new(swm::registry);
    &REGISTRY
}

/// What a World and the arrays over its memory share.
pub(crate) struct Shared {
    /// The environments' description.
    pub(crate) spec: EnvSpec,
    /// The number of environments.
    pub(crate) num_envs: usize,
    process: Process,
    core: Mutex<Core>,
}

impl Shared {
    /// The World, for this thread alone.
    pub(crate) fn lock(&self) -> PyResult<MutexGuard<'_, Core>> {
        self.process.check("this World")?;
        match self.core.try_lock() {
            Ok(core) => Ok(core),
            // A panic in the core leaves tables whole; what is in them is that of a step cut short.
            Err(TryLockError::Poisoned(poisoned)) => Ok(PoisonError::into_inner(poisoned)),
            Err(TryLockError::WouldBlock) => Err(SwmError::new_err(
                "this World is in use by another thread, or by a run whose policy called it; make one World per thread, \
                 and let policies use the infos that they are given",
            )),
        }
    }
}

/// The World, and what Python sees that the core does not keep.
pub(crate) struct Core {
    /// The environments; `None` once closed.
    pub(crate) world: Option<World>,
    /// Written by every step.
    pub(crate) mirror: Mirror,
}

impl Core {
    /// The World, unless it is closed, and its mirror.
    pub(crate) fn parts(&mut self) -> PyResult<(&mut World, &mut Mirror)> {
        let world = self.world.as_mut();
        let world = world.ok_or_else(|| SwmError::new_err("this World is closed; make a new one"))?;
        Ok((world, &mut self.mirror))
    }

    /// The World, unless it is closed.
    pub(crate) fn world(&mut self) -> PyResult<&mut World> {
        self.parts().map(|(world, _)| world)
    }
}

/// Environments of one kind, stepped together; `stable_worldmodel_rs.World` is built on it.
#[pyclass(frozen, name = "World", module = "stable_worldmodel_rs._swm")]
pub(crate) struct PyWorld {
    pub(crate) shared: Arc<Shared>,
    /// The owner of the present infos' memory.
    table: Mutex<Py<Table>>,
}

impl PyWorld {
    fn table<'py>(&self, py: Python<'py>) -> Bound<'py, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner).bind(py).clone()
    }

    /// Gives replaced columns to the arrays that show them; what is shown from now on has an owner of its own.
    pub(crate) fn retire(&self, py: Python<'_>, replaced: Batch) -> PyResult<()> {
        let fresh = Py::new(py, Table::new(Arc::clone(&self.shared)))?;
        let old = std::mem::replace(&mut *self.table.lock().unwrap_or_else(PoisonError::into_inner), fresh);
        old.get().keep(replaced);
        Ok(())
    }

    /// What was made from these options of Python.
    pub(crate) fn options(&self, options: Option<&Bound<'_, PyAny>>) -> PyResult<ResetOptions> {
        options.map_or_else(
            || Ok(ResetOptions::default()),
            |given| infos::reset_options(&self.shared.spec, given),
        )
    }
}

/// One environment's reset: slot, seed of the run, index of the episode, seed of the episode itself, options.
type Reset<'py> = (usize, u64, u64, Option<i64>, Option<Bound<'py, PyAny>>);

#[pymethods]
impl PyWorld {
    /// `settings`: a JSON object; `image`: (height, width).
    #[new]
    #[pyo3(signature = (id, num_envs, image=None, max_episode_steps=None, frame_skip=1, threads=None, settings="{}", unrecorded=None, checkpoints=None))]
    #[expect(clippy::too_many_arguments, reason = "they are keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        id: &str,
        #[pyo3(from_py_with = integers::num_envs)] num_envs: usize,
        image: Option<(usize, usize)>,
        #[pyo3(from_py_with = integers::max_episode_steps)] max_episode_steps: Option<u64>,
        #[pyo3(from_py_with = integers::frame_skip)] frame_skip: u32,
        #[pyo3(from_py_with = integers::threads)] threads: Option<usize>,
        settings: &str,
        unrecorded: Option<Vec<String>>,
        #[pyo3(from_py_with = integers::checkpoints)] checkpoints: Option<u32>,
    ) -> PyResult<Self> {
        let entry = registry().env(id).or_raise()?;
        let settings = serde_json::from_str(settings).map_err(|error| {
            SwmError::new_err(format!("the settings of `{id}` are no JSON object: {error}"))
        })?;
        let image = image.map(|(height, width)| ImageSize { height, width });
        let options = WorldOptions::new(num_envs)
            .env(EnvConfig { image, settings })
            .max_episode_steps(max_episode_steps)
            .frame_skip(frame_skip)
            .threads(threads)
            .unrecorded(unrecorded.unwrap_or_default())
            .checkpoints(checkpoints);
        let world = py.detach(|| World::new(entry, options)).or_raise()?;
        let mirror = Mirror::new(&world)?;
        let shared = Shared {
            spec: world.spec().clone(),
            num_envs,
            process: Process::current(),
            core: Mutex::new(Core { world: Some(world), mirror }),
        };
        let shared = Arc::new(shared);
        let table = Mutex::new(Py::new(py, Table::new(Arc::clone(&shared)))?);
        Ok(Self { shared, table })
    }

    /// The environment's id.
    #[getter]
    fn id(&self) -> &str {
        &self.shared.spec.id
    }

    /// The number of environments.
    #[getter]
    fn num_envs(&self) -> usize {
        self.shared.num_envs
    }

    /// What the environments are, as JSON: `action` (a space), `fields` (name, dtype, shape, kind), `factors` (name, doc,
    /// space, default, …), `time_step_s`, `start_columns`, `goal_columns`, `start_extras`, `goal_extras`.
    fn spec_json(&self) -> String {
        let spec = &self.shared.spec;
        serde_json::json!({
            "id": spec.id,
            "action": spec.action,
            "fields": spec.fields,
            "factors": spec.factors,
            "time_step_s": spec.time_step_s,
            "start_columns": spec.start_columns,
            "goal_columns": spec.goal_columns,
            "start_extras": spec.start_extras,
            "goal_extras": spec.goal_extras,
        })
        .to_string()
    }

    /// What renders the images, in words; None: always the same, or none are rendered.
    fn renderer(&self) -> PyResult<Option<String>> {
        Ok(self.shared.lock()?.world()?.renderer())
    }

    /// The infos as they stand: name -> array `(N, 1, …)` over the World's own memory, written by every step and reset.
    fn infos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (table, core) = (self.table(py), self.shared.lock()?);
        let infos = PyDict::new(py);
        for (name, array) in views::infos(&table, &core)? {
            infos.set_item(name, array)?;
        }
        Ok(infos)
    }

    /// What the last step gave, `(N,)` each: `rewards` (f32), `terminateds`, `truncateds` (bool); written by every step.
    fn results<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (table, core) = (self.table(py), self.shared.lock()?);
        let results = PyDict::new(py);
        for (name, array) in views::results(&table, &core)? {
            results.set_item(name, array)?;
        }
        Ok(results)
    }

    /// Resets chosen environments: a list of (slot, seed of the run, index of the episode, seed of the episode or None,
    /// options or None).
    fn reset(&self, py: Python<'_>, resets: Vec<Reset<'_>>) -> PyResult<()> {
        let mut all = Vec::with_capacity(resets.len());
        for (slot, run, index, seed, options) in resets {
            let mut options = self.options(options.as_ref())?;
            if let Some(seed) = seed {
                let seed = u64::try_from(seed)
                    .map_err(|_| SwmError::new_err(format!("the seed {seed} is negative; use 0 or more")))?;
                options.seed = Some(EpisodeSeed::new(seed));
            }
            all.push((slot, LiveEpisode::of(run, index), options));
        }
        py.detach(|| {
            let mut core = self.shared.lock()?;
            let resets: Vec<_> =
                all.iter().map(|(slot, episode, options)| (*slot, *episode, options)).collect();
            let (world, mirror) = core.parts()?;
            world.reset_slots(&resets).or_raise()?;
            all.iter().for_each(|(slot, ..)| mirror.reset(*slot));
            Ok(())
        })
    }

    /// Factors that keep their defaults under these options, though they are sampled by default.
    fn unsampled_defaults(&self, options: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
        let options = self.options(Some(options))?;
        let left = options.unsampled_defaults(&self.shared.spec.factors);
        Ok(left.into_iter().map(str::to_owned).collect())
    }

    /// The factors that a reset samples which asks for `asked`: names, groups, `*.color`, `default`, `all`. None: no request.
    #[pyo3(signature = (asked=None))]
    fn sampled_factors(&self, asked: Option<Vec<String>>) -> Vec<&str> {
        let asked = asked.unwrap_or_else(|| vec!["default".to_owned()]);
        let is_sampled = |factor: &&FactorSpec| asked.iter().any(|asked| factor.is_selected_by(asked));
        self.shared.spec.factors.iter().filter(is_sampled).map(|factor| factor.name.as_str()).collect()
    }

    /// Steps every environment that is in an episode, of those that `mask` chooses, with `actions` `(N, …)`. Without actions:
    /// all of them, with those of the attached policy.
    #[pyo3(signature = (actions=None, mask=None))]
    fn step(
        &self,
        py: Python<'_>,
        actions: Option<&Bound<'_, PyAny>>,
        mask: Option<Vec<bool>>,
    ) -> PyResult<()> {
        let given = actions.map(|actions| infos::actions(&self.shared.spec, self.shared.num_envs, actions));
        let given = given.transpose()?;
        py.detach(|| {
            let mut core = self.shared.lock()?;
            let (world, mirror) = core.parts()?;
            if let Some(mask) = &mask
                && mask.len() != self.shared.num_envs
            {
                let (found, num_envs) = (mask.len(), self.shared.num_envs);
                return Err(SwmError::new_err(format!(
                    "the mask has {found} values for {num_envs} environments"
                )));
            }
            mirror.begin_step(world, mask.as_deref());
            match (&given, &mask) {
                (None, None) => world.step(),
                (None, Some(_)) => {
                    return Err(SwmError::new_err("a mask needs actions; give both, or neither"));
                }
                (Some(actions), None) => world.step_with(actions.as_slice()),
                (Some(actions), Some(mask)) => world.step_slots(mask, actions.as_slice()),
            }
            .or_raise()?;
            mirror.end_step(world.infos(), world.actions());
            Ok(())
        })
    }

    /// Every environment amid its episode, as bytes that `restore` takes; None of one that was not reset.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Vec<Option<Bound<'py, PyBytes>>>> {
        let saved = py.detach(|| {
            let mut core = self.shared.lock()?;
            let (world, mirror) = core.parts()?;
            let save = |slot| {
                world.episode(slot)?;
                let save = || {
                    let mut bytes = EnvState::new();
                    bytes.store(&self.shared.spec.id, &(world.save_slot(slot)?, mirror.save(slot)))?;
                    Ok::<_, WorldError>(bytes)
                };
                Some(save())
            };
            let saved: Result<Vec<_>, _> =
                (0..self.shared.num_envs).map(|slot| save(slot).transpose()).collect();
            saved.or_raise()
        })?;
        Ok(saved.into_iter().map(|bytes| Some(PyBytes::new(py, bytes?.bytes()))).collect())
    }

    /// Goes back to what `save` gave, of a World with the same environments and options.
    fn restore(&self, py: Python<'_>, saved: Vec<Option<Vec<u8>>>) -> PyResult<()> {
        py.detach(|| {
            let mut core = self.shared.lock()?;
            let (world, mirror) = core.parts()?;
            for (slot, bytes) in saved.into_iter().enumerate() {
                let Some(bytes) = bytes else { continue };
                let (saved, row): (SavedSlot, SavedRow) =
                    EnvState::from_bytes(bytes).load(&self.shared.spec.id).or_raise()?;
                world.restore_slot(slot, &saved).or_raise()?;
                if !mirror.restore(slot, &row) {
                    return Err(SwmError::new_err("the saved action is of another environment"));
                }
            }
            Ok(())
        })
    }

    /// Attaches a policy by its name and arguments (`expert`, `cem:samples=300`), or a stand-in that is called `foreign`
    /// for one that is a Python object; gives its description. The infos may have other columns then.
    #[pyo3(signature = (text=None, foreign=None))]
    fn set_policy(&self, py: Python<'_>, text: Option<&str>, foreign: Option<String>) -> PyResult<String> {
        let (replaced, description) = py.detach(|| {
            let mut core = self.shared.lock()?;
            let world = core.world()?;
            let policy: Box<dyn Policy> = match text {
                Some(text) => registry().policy(text, &*world).or_raise()?,
                None => Box::new(Foreign(foreign.unwrap_or_else(|| "policy".to_owned()))),
            };
            let replaced = world.exchange_policy(policy).or_raise()?;
            Ok::<_, PyErr>((replaced, world.policy_description().unwrap_or_default()))
        })?;
        replaced.map_or(Ok(()), |infos| self.retire(py, infos))?;
        Ok(description)
    }

    /// What a user should know of a native policy in this world: images of another size than its model was trained on, a search that keeps
    /// most samples.
    fn notes_on(&self, py: Python<'_>, policy: &str) -> PyResult<Vec<String>> {
        py.detach(|| {
            let mut core = self.shared.lock()?;
            let (world, mut notes) = (core.world()?, Vec::<Message>::new());
            let args = policy_args(registry(), policy).or_raise()?;
            note_elites(registry(), world.entry(), &args, &mut notes);
            let trained = model_image(registry(), world.entry(), policy);
            note_images(policy, trained, world.options().env.image, &mut notes);
            Ok(notes.iter().map(ToString::to_string).collect())
        })
    }

    /// The seed of a native policy's own noise; 0: noise comes from the episodes' seeds.
    fn set_policy_seed(&self, #[pyo3(from_py_with = integers::seed)] seed: u64) -> PyResult<()> {
        self.shared.lock()?.world()?.set_policy_seed(seed);
        Ok(())
    }

    /// Judges success by a rule, a JSON object; `{}` gives the environment's own rule back.
    fn set_success(&self, rule: &str) -> PyResult<()> {
        let rule: SuccessRule = serde_json::from_str(rule)
            .map_err(|error| SwmError::new_err(format!("the rule of success is none: {error}")))?;
        self.shared.lock()?.world()?.set_success(&rule).or_raise()
    }

    /// Shows images through distractors (`color:0.3`), or as they are.
    fn set_distractors(&self, distractors: Vec<String>) -> PyResult<()> {
        let transform = swm::distractors::parse_all(&distractors)
            .map_err(|error| SwmError::new_err(format!("distractors: {error}")))?;
        self.shared.lock()?.world()?.set_transform(transform);
        Ok(())
    }

    /// Changes the time limit of the episodes to come; returns the old one.
    fn set_max_episode_steps(
        &self,
        #[pyo3(from_py_with = integers::limit)] limit: Option<u64>,
    ) -> PyResult<Option<u64>> {
        Ok(self.shared.lock()?.world()?.set_max_episode_steps(limit))
    }

    /// Frees the environments. Arrays that were taken stay valid.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let mut core = self.shared.lock()?;
        let Some(world) = core.world.take() else { return Ok(()) };
        drop(core);
        let infos = py.detach(|| world.into_infos());
        self.retire(py, infos)
    }

    /// Whether `close` was called.
    #[getter]
    fn closed(&self) -> PyResult<bool> {
        Ok(self.shared.lock()?.world.is_none())
    }
}

/// The ids of the environments of this package, and what each is.
#[pyfunction]
fn env_ids() -> Vec<(&'static str, &'static str)> {
    registry().all::<EnvEntry>().map(|entry| (entry.id, entry.summary)).collect()
}

/// Further names of environments, and their ids.
#[pyfunction]
fn env_aliases() -> Vec<(&'static str, &'static str)> {
    let entries = registry().all::<EnvEntry>();
    entries.flat_map(|entry| entry.aliases.iter().map(|alias| (*alias, entry.id))).collect()
}

/// The seed of episode `index` of the run with seed `run`, as it stands in the column `seed`.
#[pyfunction]
fn episode_seed(run: u64, index: u64) -> i64 {
    EpisodeSeed::of(run, index).value()
}

/// Adds this file's classes and functions to the module.
pub(crate) fn add(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(env_ids, m)?)?;
    m.add_function(wrap_pyfunction!(env_aliases, m)?)?;
    m.add_function(wrap_pyfunction!(episode_seed, m)?)?;
    m.add_class::<PyWorld>()?;
    m.add_class::<Table>()
}
