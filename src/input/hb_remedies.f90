!> What to do about a motion, by its status (hb_outcome): sentences that name groups, keys and, without a program, operations.
module hb_remedies
   use hb_outcome, only: outcome
   implicit none
   private
   public :: remedy_of

   character(*), parameter :: texts(0:22) = [character(232) :: &
      "Resume the run to solve it.", &
      "Verification checks it by time integration. If an order was given, a tolerance (&accuracy) would choose it.", &
      "Check units and loads first. Then continue from a solved point: a sweep with "// &
         "first_guess = 'neighbour' in &solver; or start from time integration.", &
      "Raise the work limit, or continue from a solved point: a sweep with first_guess = "// &
         "'neighbour' in &solver.", &
      "Constrain rigid body motions, and add damping where a resonance is excited. At a fold, shift the "// &
         "parameter slightly.", &
      "Look for loads or stiffnesses of a wrong magnitude, the end of a table, or a law that divides by "// &
         "zero; a check tests the derivatives of the laws.", &
      "Remove the cause, then solve the point again.", &
      "", &
      "", &
      "Raise order and samples; hard impacts on a wall need very high orders.", &
      "Solve the model with fewer tones.", &
      "Integrate from a small disturbance: does it grow? If a large motion coexists with a stable "// &
         "equilibrium, start near it with &start.", &
      "Look for a user law that ends the process. When it is repaired, solve the point again (resume with --retry).", &
      "Check units and loads first. Then continue from smaller loads: a sweep with "// &
         "first_guess = 'neighbour' in &solver.", &
      "Solve the model with the single tone that the message gives.", &
      "Allow more time (&solver time_limit), or continue from a solved point: a sweep with first_guess = "// &
         "'neighbour'.", &
      "A higher order does not help. Give the wall its restitution (of rigid_wall, or of "// &
         "&integration for all walls), or its stiffness (elastic_stop).", &
      "Ignore the row.", &
      "The motion is a valid solution; its error is the spread of the averages over time. Verification "// &
         "checks that it persists.", &
      "Divide the frequency by the number in the message, and multiply tuples and orders by "// &
         "it.", &
      "The motion is chaotic, or has a further tone: time integration with &integration n_peaks finds its "// &
         "frequencies.", &
      "The stored motion is the first one that repeats with the tones. Start near another one with &start.", &
      "Beyond pull-in, or another limit of the law, there may be no motion: a curve (&curve) over the load or voltage ends its "// &
         "stable motions at a fold. Before it, continue from smaller loads."]

   integer, parameter :: max_text = 400
   character(*), parameter :: of_order(outcome%truncated:outcome%aliased) = [character(160) :: &
      "double it, or leave it out for a tolerance. If the error is acceptable, raise &error_estimate truncation.", &
      "double the samples, or remove &sampling and &harmonics; contact and friction need many more samples than harmonics."]
   character(*), parameter :: of_tolerance(outcome%truncated:outcome%aliased) = [character(160) :: &
      "raise its limits max_work and max_harmonics. If the error is acceptable, raise the tolerance.", &
      "remove &sampling, or raise max_work and max_samples."]

contains

   !> Gives the sentences for a status of `hb_outcome`; a number that is not a status has those of the nearest one.
   pure function remedy_of(status, is_adaptive) result(text)
      integer, intent(in) :: status
      logical, intent(in), optional :: is_adaptive !! harmonics or samples are chosen for a tolerance; else sentences for both cases
      character(max_text) :: text                                     !! padded with blanks

      text = texts(known(status))
      if (status < lbound(of_order, 1) .or. status > ubound(of_order, 1)) return
      if (.not. present(is_adaptive)) then
         text = "With a given order: "//trim(of_order(status))//" With a tolerance, as by default: "//trim(of_tolerance(status))
      else if (is_adaptive) then
         text = "With this tolerance: "//trim(of_tolerance(status))
      else
         text = "With this order: "//trim(of_order(status))
      end if
   end function remedy_of

   !> The status, or the nearest one.
   pure integer function known(status)
      integer, intent(in) :: status

      known = max(lbound(texts, 1), min(status, ubound(texts, 1)))
   end function known
end module hb_remedies
