//! A trained agent: from observation to action, without the noise of exploration.

use swm_core::{Actions, Policy, PolicyError, Space, View};
use swm_solvers::ActionMap;

use crate::error::BaselineError;
use crate::online::TrainedAgent;

/// Acts as the agent thinks best, one observation at a time. Every action belongs to its environment alone.
pub struct AgentPolicy {
    trained: TrainedAgent,
    /// From the agent's values to actions of the last requested space.
    map: Option<(Space, ActionMap)>,
    vector: Vec<f32>,
    action: Vec<f32>,
}

impl AgentPolicy {
    /// A policy that acts as `trained` does.
    pub fn new(trained: TrainedAgent) -> Self {
        let action = vec![0.0; trained.config.interface.action_dim()];
        Self { trained, map: None, vector: Vec::new(), action }
    }
}

impl Policy for AgentPolicy {
    fn describe(&self) -> String {
        let TrainedAgent { agent, step, weights, options, .. } = &self.trained;
        let options: String = options.iter().map(|(name, value)| format!(",{name}={value}")).collect();
        let weights = weights.get(..12).unwrap_or(weights);
        format!("{}:step={step},weights={weights}{options}", agent.config().agent)
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        let Self { trained: TrainedAgent { agent, config, .. }, map, vector, action } = self;
        let space = actions.space();
        if map.as_ref().is_none_or(|(known, _)| known != space) {
            *map = Some((space.clone(), config.interface.action_map(space).map_err(other)?));
        }
        let (_, map) = map.as_ref().expect("made above");
        for slot in view.live() {
            let Some(live) = view.row(slot) else { continue };
            let observation = config.interface.observe(live.row, vector).map_err(other)?;
            agent.act(slot, &live.episode, false, &observation, action).map_err(other)?;
            map.write(action, &mut actions.row(slot));
        }
        Ok(())
    }

    fn is_parallel(&self) -> bool {
        false
    }
}

fn other(error: BaselineError) -> PolicyError {
    PolicyError::Other(Box::new(error))
}
