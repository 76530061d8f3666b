//! Plans with their states as variables: lines from start to goal, losses and derivatives, steps of an optimizer, noise.

use crate::bounds::clamp;
use crate::descent::Rule;
use crate::error::PlanError;
use crate::problem::{PlanKey, Problem};
use crate::sampling::Noise;
use crate::steps::{StateSteps, StepBatch};

/// Sequences of one solve: M = B × S of them.
pub(crate) struct Lifted<'w> {
    /// S, H, D, W.
    pub(crate) shape: [usize; 4],
    /// `[M, H, D]` each: blocks, derivative by them, state of the optimizer.
    pub(crate) blocks: &'w mut [f32],
    pub(crate) gradient: &'w mut [f32],
    pub(crate) block_memory: [&'w mut [f32]; 2],
    /// `[M, H, W]` each: states before blocks, states after them, what these are compared with, derivative by the states, state of the
    /// optimizer.
    pub(crate) states: &'w mut [f32],
    pub(crate) next: &'w mut [f32],
    pub(crate) targets: &'w mut [f32],
    pub(crate) by_state: &'w mut [f32],
    pub(crate) state_memory: [&'w mut [f32]; 2],
    /// `[B, W]` each.
    pub(crate) starts: &'w mut [f32],
    pub(crate) goals: &'w mut [f32],
    /// `[H, D]` each.
    pub(crate) low: &'w mut [f32],
    pub(crate) high: &'w mut [f32],
    /// `[M]`: the loss of each sequence.
    pub(crate) losses: &'w mut [f64],
    /// `[M]`: 1 where a loss was not finite.
    pub(crate) stopped: &'w mut [u32],
}

impl<'w> Lifted<'w> {
    /// In memory of 4 × M × H × D values for the blocks, 6 × M × H × W for the states, and 2 × B × W for the ends.
    pub(crate) fn new(
        shape: [usize; 4],
        [of_blocks, of_states, of_ends]: [&'w mut [f32]; 3],
        [low, high]: [&'w mut [f32]; 2],
        losses: &'w mut [f64],
        stopped: &'w mut [u32],
    ) -> Self {
        let [blocks, gradient, block_mean, block_square] = equal_parts(of_blocks);
        let [states, next, targets, by_state, state_mean, state_square] = equal_parts(of_states);
        let [starts, goals] = equal_parts(of_ends);
        let (block_memory, state_memory) = ([block_mean, block_square], [state_mean, state_square]);
        Self {
            shape,
            blocks,
            gradient,
            block_memory,
            states,
            next,
            targets,
            by_state,
            state_memory,
            starts,
            goals,
            low,
            high,
            losses,
            stopped,
        }
    }
}

/// A slice in N parts of one length.
fn equal_parts<const N: usize>(mut rest: &mut [f32]) -> [&mut [f32]; N] {
    let size = rest.len() / N;
    std::array::from_fn(|_| {
        let (part, tail) = std::mem::take(&mut rest).split_at_mut(size);
        rest = tail;
        part
    })
}

impl Lifted<'_> {
    /// H × D and H × W.
    fn sizes(&self) -> [usize; 2] {
        let [_, horizon, dim, width] = self.shape;
        [horizon * dim, horizon * width]
    }

    /// The blocks of a sequence: `[H, D]`.
    pub(crate) fn block_of(&mut self, index: usize) -> &mut [f32] {
        let [size, _] = self.sizes();
        &mut self.blocks[index * size..][..size]
    }

    /// Puts the states evenly on the line from start to goal.
    pub(crate) fn draw_lines(&mut self) {
        let [samples, horizon, _, width] = self.shape;
        for (index, state) in self.states.chunks_exact_mut(width).enumerate() {
            let (episode, part) = (index / (samples * horizon), (index % horizon) as f32 / horizon as f32);
            let ends = self.starts[episode * width..].iter().zip(&self.goals[episode * width..]);
            state
                .iter_mut()
                .zip(ends)
                .for_each(|(value, (start, goal))| *value = start + part * (goal - start));
        }
    }

    /// Sets what predictions are compared with: the next state and the goal, weighted.
    pub(crate) fn aim(&mut self, goal_weight: f32) {
        let [samples, horizon, _, width] = self.shape;
        for (index, target) in self.targets.chunks_exact_mut(width).enumerate() {
            let (episode, step) = (index / (samples * horizon), index % horizon);
            let goal = &self.goals[episode * width..][..width];
            let next = if step + 1 < horizon { &self.states[(index + 1) * width..][..width] } else { goal };
            for (target, (next, goal)) in target.iter_mut().zip(next.iter().zip(goal)) {
                *target = (next + goal_weight * goal) / (1.0 + goal_weight);
            }
        }
    }

    /// Losses, and the derivatives by blocks and states.
    pub(crate) fn differentiate(
        &mut self,
        model: &mut dyn StateSteps,
        problem: &Problem<'_>,
        goal_weight: f64,
    ) -> Result<(), PlanError> {
        let [samples, horizon, _, width] = self.shape;
        let candidates = problem.candidates(self.blocks, samples);
        let steps = StepBatch { candidates, states: self.states, targets: self.targets };
        model.step_toward(&steps, self.next, self.gradient)?;
        let scale = (1.0 + goal_weight) as f32;
        self.gradient.iter_mut().for_each(|slope| *slope *= scale);
        let [_, values] = self.sizes();
        for (index, loss) in self.losses.iter_mut().enumerate() {
            let goal = &self.goals[index / samples * width..][..width];
            let (states, next) =
                (&self.states[index * values..][..values], &self.next[index * values..][..values]);
            let slopes = &mut self.by_state[index * values..][..values];
            *loss = 0.0;
            for (step, found) in next.chunks_exact(width).enumerate() {
                let after = if step + 1 < horizon { &states[(step + 1) * width..][..width] } else { goal };
                for (at, (&found, (&after, &goal))) in found.iter().zip(after.iter().zip(goal)).enumerate() {
                    let [off, far] = [f64::from(found - after), f64::from(found - goal)];
                    *loss += off * off + goal_weight * far * far;
                    if step + 1 < horizon {
                        slopes[(step + 1) * width + at] = 2.0 * (after - found);
                    }
                }
            }
        }
        Ok(())
    }

    /// Stops sequences whose loss or gradient is not finite; an error where an episode has no other.
    pub(crate) fn screen(
        &mut self,
        problem: &Problem<'_>,
        iteration: usize,
        non_finite: &mut [u64],
    ) -> Result<(), PlanError> {
        let ([samples, ..], [size, _]) = (self.shape, self.sizes());
        let gradients = self.gradient.chunks_exact(size);
        for ((loss, stopped), (index, gradient)) in
            self.losses.iter_mut().zip(&mut *self.stopped).zip(gradients.enumerate())
        {
            if *stopped == 0 && !(loss.is_finite() && gradient.iter().all(|slope| slope.is_finite())) {
                *stopped = 1;
                non_finite[index / samples] += 1;
            }
            if *stopped == 1 {
                *loss = f64::INFINITY;
            }
        }
        match self
            .stopped
            .chunks_exact(samples)
            .position(|stopped| stopped.iter().all(|&stopped| stopped == 1))
        {
            Some(at) => {
                let PlanKey { episode, plan, .. } = problem.keys[at];
                Err(PlanError::NoFiniteCost { episode, plan, iteration, samples })
            }
            None => Ok(()),
        }
    }

    /// Steps on blocks and states: step `number`, from 1, since the optimizer began.
    pub(crate) fn step(&mut self, [of_blocks, of_states]: [Rule; 2], number: usize) {
        self.step_blocks(of_blocks, number);
        let [_, values] = self.sizes();
        let width = self.shape[3];
        let [first, second] = &mut self.state_memory;
        let memories = first.chunks_exact_mut(values).zip(second.chunks_exact_mut(values));
        let sequences =
            self.states.chunks_exact_mut(values).zip(self.by_state.chunks_exact(values)).zip(memories);
        for (((states, slopes), (first, second)), &stopped) in sequences.zip(&*self.stopped) {
            // The first state is the start, which stays.
            if stopped == 0 {
                of_states.step(
                    number as u32,
                    &mut states[width..],
                    &slopes[width..],
                    [&mut first[width..], &mut second[width..]],
                );
            }
        }
    }

    pub(crate) fn step_blocks(&mut self, rule: Rule, number: usize) {
        let [size, _] = self.sizes();
        let [first, second] = &mut self.block_memory;
        let memories = first.chunks_exact_mut(size).zip(second.chunks_exact_mut(size));
        let sequences =
            self.blocks.chunks_exact_mut(size).zip(self.gradient.chunks_exact(size)).zip(memories);
        for (((blocks, slopes), (first, second)), &stopped) in sequences.zip(&*self.stopped) {
            if stopped == 0 && slopes.iter().all(|slope| slope.is_finite()) {
                rule.step(number as u32, blocks, slopes, [first, second]);
                clamp(blocks, self.low, self.high);
            }
        }
    }

    /// Adds noise to the states.
    pub(crate) fn shake(&mut self, keys: &[PlanKey], noise: Noise, iteration: usize, std: f32) {
        let ([samples, _, _, width], [_, values]) = (self.shape, self.sizes());
        // The predictions are used up: their memory is free.
        let sequences = self.states.chunks_exact_mut(values).zip(self.next.chunks_exact_mut(values));
        for (index, (states, normal)) in sequences.enumerate() {
            noise.fill(
                &keys[index / samples],
                iteration as u32,
                (index % samples) as u32,
                &mut normal[width..],
            );
            states[width..]
                .iter_mut()
                .zip(&normal[width..])
                .for_each(|(value, normal)| *value += std * normal);
        }
    }

    /// Resets the optimizers.
    pub(crate) fn forget(&mut self) {
        self.block_memory.iter_mut().chain(&mut self.state_memory).for_each(|memory| memory.fill(0.0));
    }

    /// Variances of the blocks of a sequence, `[H]`, by how far the states before them are off the line from start to goal; that of the
    /// first block, whose state is fixed, is the mean of the others.
    pub(crate) fn states_off(&self, index: usize, [scale, least]: [f32; 2], variances: &mut [f32]) {
        let ([samples, horizon, _, width], [_, values]) = (self.shape, self.sizes());
        let [start, goal] =
            [&*self.starts, &*self.goals].map(|ends| &ends[index / samples * width..][..width]);
        let states = self.states[index * values..][..values].chunks_exact(width);
        for (step, (variance, state)) in variances.iter_mut().zip(states).enumerate() {
            let part = step as f32 / horizon as f32;
            let ends = start.iter().zip(goal);
            let off =
                state.iter().zip(ends).map(|(value, (start, goal))| value - start - part * (goal - start));
            *variance = off.map(|off| off * off).sum::<f32>() / width as f32;
        }
        if let [first, rest @ ..] = variances
            && !rest.is_empty()
        {
            *first = rest.iter().sum::<f32>() / rest.len() as f32;
        }
        variances.iter_mut().for_each(|variance| *variance = scale * *variance + least);
    }
}
