!> The table of the columns of a motion: name, unit, shape, meaning, condition, and the component with its value.
!> This is the only declaration of columns. Types that extend `columns_t` go through the table with a motion: result
!> files list their datasets and write rows in this way (hb_result_columns), other programs request a column by its
!> name (hb_session_columns). A new column needs a line here and one in docs/user/datasets.md, which tests/cases/test_schema.py
!> compares.
!> Shapes are names of dimensions after that of the point, in the order of h5py: slowest first.
module hb_motion_columns
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_advice, only: n_advice, stored_names
   use hb_attempts, only: attempt_rules
   use hb_kinds, only: wp
   use hb_motion_result, only: curve_position_t, motion_result_t
   use hb_outcome, only: is_solved, outcome_names, reason_names
   use hb_point_kinds, only: curve_kind_names, kind_attribute_t, kind_attributes
   use hb_solver_types, only: fallback_names
   use hb_stability, only: noise_status, noise_status_names, stability_method_names, unknown_because_names
   use hb_text, only: join
   implicit none
   private
   public :: columns_t, find_shared_unit, max_advice, max_attempts, max_values, of_dof, of_force, of_rate, of_square, &
      of_square_by_rate

   integer, parameter :: max_advice = 6                 !! that is stored of a motion
   integer, parameter :: max_values = 4                 !! of each advice
   integer, parameter :: max_attempts = 24              !! that are stored of a motion: the first ones

   ! Units that depend on the degrees of freedom along an axis of a row: theirs, and those of the forces on them and of their rates.
   character(*), parameter :: of_dof = "of the degree of freedom", of_force = "of its force", of_rate = "of its rate", &
      of_square = "of its square", of_square_by_rate = "of its square per hertz"

   !> A visitor of the table: its procedures receive each existing column with its values, if they are known. `integer_array` and
   !> `real_array` are for arrays that may not be allocated: gfortran reads the bounds of what is passed to `values(..)`.
   type, abstract :: columns_t
      logical :: has_accuracy = .false.                 !! a tolerance is requested
      logical :: has_own_tuples = .false.               !! each motion may have its own tuples
      logical :: has_improved = .false.                 !! improved coefficients are requested
      logical :: has_curve = .false.                    !! motions are on a curve
      logical :: has_surfaces = .false.                 !! samples of motions and forces are requested
      logical :: has_outputs = .false.                  !! the tolerance applies to named outputs
      logical :: has_gradient = .false.                 !! derivatives with respect to values of the input are requested
      logical :: has_response_gradient = .false.        !! those of one response alone
      logical :: has_one_tone = .false.
      logical :: has_noise = .false.                    !! loads of noise
      logical :: has_noise_spectrum = .false.           !! a spectral density is requested
      integer :: n_multipliers = 0, n_curve_unknowns = 0   !! lengths of these axes
      character(:), allocatable :: curve_path           !! of the value along the curve, in the input; its column and its unit
      character(:), allocatable :: curve_column, curve_units
      logical :: is_there = .true.                      !! the following columns exist
      logical :: is_known = .true.                      !! their values are known for the motion
      logical :: describes = .false.                    !! attributes of columns are wanted
   contains
      procedure(column_of_integers), deferred :: integer
      procedure(column_of_reals), deferred :: real
      procedure(column_of_text), deferred :: text
      procedure :: integer_array => columns_integer_array
      procedure :: real_array => columns_real_array
      procedure :: attribute => columns_attribute
      procedure :: append_connected => columns_append_connected
   end type columns_t

   abstract interface
      subroutine column_of_integers(self, name, units, axes, long_name, values, flags, lowest)
         import :: columns_t
         class(columns_t), intent(inout) :: self
         character(*), intent(in) :: name, units, axes, long_name
         integer, intent(in), contiguous, optional :: values(..)       !! not present: not known
         character(*), intent(in), optional :: flags(:)                !! names of the values `lowest`, `lowest` + 1, ...
         integer, intent(in), optional :: lowest                       !! default: 0
      end subroutine column_of_integers

      subroutine column_of_reals(self, name, units, axes, long_name, values)
         import :: columns_t, wp
         class(columns_t), intent(inout) :: self
         character(*), intent(in) :: name, units, axes, long_name
         real(wp), intent(in), contiguous, optional :: values(..)
      end subroutine column_of_reals

      subroutine column_of_text(self, name, units, axes, long_name, value)
         import :: columns_t
         class(columns_t), intent(inout) :: self
         character(*), intent(in) :: name, units, axes, long_name
         character(*), intent(in), optional :: value
      end subroutine column_of_text
   end interface

contains

   !> Receives an attribute of the column visited last, if attributes are wanted. By default it is not used.
   subroutine columns_attribute(self, name, text)
      class(columns_t), intent(inout) :: self
      character(*), intent(in) :: name, text
   end subroutine columns_attribute

   !> An array of integers, not known if it is not allocated.
   subroutine columns_integer_array(self, name, units, axes, long_name, values)
      class(columns_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, allocatable, intent(in) :: values(..)

      if (.not. allocated(values)) then
         call self%integer(name, units, axes, long_name)
         return
      end if
      select rank (values)                              ! the same for each: gfortran 12 passes no array of any rank on
      rank (1)
         call self%integer(name, units, axes, long_name, values)
      rank (2)
         call self%integer(name, units, axes, long_name, values)
      end select
   end subroutine columns_integer_array

   !> An array of reals, not known if it is not allocated.
   subroutine columns_real_array(self, name, units, axes, long_name, values)
      class(columns_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), allocatable, intent(in) :: values(..)

      if (.not. allocated(values)) then
         call self%real(name, units, axes, long_name)
         return
      end if
      select rank (values)                              ! the same for each: gfortran 12 passes no array of any rank on
      rank (1)
         call self%real(name, units, axes, long_name, values)
      rank (2)
         call self%real(name, units, axes, long_name, values)
      rank (3)
         call self%real(name, units, axes, long_name, values)
      rank (4)
         call self%real(name, units, axes, long_name, values)
      end select
   end subroutine columns_real_array

   !> Visits all columns of a motion, in the order of the file.
   subroutine columns_append_connected(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      call outcome_columns(t, m)
      call accuracy_columns(t, m)
      call motion_columns(t, m)
      call error_estimate_columns(t, m)
      call stability_columns(t, m)
      call noise_columns(t, m)
      call gradient_columns(t, m)
      call curve_columns(t, m)
      call surface_columns(t, m)
      t%is_there = .true.
      t%is_known = .true.
   end subroutine columns_append_connected

   !> The numbers of the advice on a failed search, and its values.
   subroutine advice_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      integer :: i, n, numbers(max_advice)
      real(wp) :: values(max_values, max_advice)

      numbers = 0
      values = ieee_value(1.0_wp, ieee_quiet_nan)
      if (.not. is_solved(m%status)) then
         do i = 1, min(n_advice(m%advice), max_advice)
            numbers(i) = m%advice%items(i)%number
            n = min(size(m%advice%items(i)%values), max_values)
            values(:n, i) = m%advice%items(i)%values(:n)
         end do
      end if
      call t%integer("advice", "1", "advice_item", "what may help, of the table of advice", numbers, stored_names)
      call t%real("advice_values", "1", "advice_item advice_value", "values of each advice; NaN: none", values)
   end subroutine advice_columns

   subroutine outcome_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      integer :: attempts(max_attempts), depth(max_attempts), n, status(max_attempts)
      real(wp) :: least(max_attempts)
      character(:), allocatable :: message

      call t%integer("status", "1", "", "outcome of the point", m%status, outcome_names)
      call t%integer("reason", "1", "", "what ended the work, where the next step depends on it", m%reason, reason_names)
      call t%integer("n_periods", "1", "", &
         "periods of the tones after which a subharmonic motion repeats; 0: not known", m%n_periods)
      call m%describe(message)
      call t%text("message", "1", "message_byte", "reason for a failure, and advice", message)
      call advice_columns(t, m)
      attempts = 0
      depth = 0
      status = 0
      least = ieee_value(1.0_wp, ieee_quiet_nan)
      if (allocated(m%attempts)) then
         n = min(size(m%attempts), max_attempts)
         attempts(:n) = m%attempts(:n)%rule
         depth(:n) = m%attempts(:n)%depth
         status(:n) = m%attempts(:n)%status
         where (m%attempts(:n)%best < huge(1.0_wp)) least(:n) = m%attempts(:n)%best
      end if
      call t%integer("attempts", "1", "attempt", "what was tried, in order, each attempt before those within it", attempts, &
                     [character(len(attempt_rules%name)) :: "none", attempt_rules%name])
      call t%integer("attempt_depth", "1", "attempt", "attempts that each attempt is part of", depth)
      call t%integer("attempt_status", "1", "attempt", "outcome of each attempt", status, outcome_names)
      call t%real("attempt_residual", "1", "attempt", "least residual norm of each attempt, relative; NaN: none", least)
      call t%integer("iterations", "1", "", "iterations of the solver", m%iterations)
      call t%integer("fallback", "1", "", "what was needed in addition to the direct attempt", m%fallback, fallback_names)
      call t%integer("evaluations", "1", "", "evaluations of the residual", m%evaluations)
      call t%real("residual", "1", "", "residual norm relative to the scale of the forces", m%residual)
      call t%real("solve_seconds", "s", "", "wall time of the point", m%solve_seconds)
      call t%real("setup_seconds", "s", "", "part of it: dynamic stiffness, plans, initial guess", m%setup_seconds)
      call t%real("iteration_seconds", "s", "", "part of it: the solver", m%solver_seconds)
      call t%real("error_estimate_seconds", "s", "", "part of it: the error estimate", m%error_estimate_seconds)
      call t%integer("rank", "1", "", "rank or process that solved the point", m%rank)
      call t%integer("n_harmonics", "1", "", "number of harmonics in the set of the point", m%n_harmonics)
      call t%integer("n_unknowns", "1", "", "number of unknowns of the equations that were solved", m%n_unknowns)
      call t%integer("is_odd", "1", "", &
         "1 if only odd tuples were unknowns, because the equations are odd", merge(1, 0, m%is_odd))
      call t%integer("n_full_stick", "1", "", &
         "number of friction laws that never slip: the solution for loading from rest, one of many", m%n_full_stick)
      call t%integer("is_beyond_tables", "1", "", &
         "1 if the motion has frequencies beyond a table, whose ends apply there", merge(1, 0, m%is_beyond_tables))
      call t%integer("n_motions", "1", "", &
         "number of motions found by time integration from several starts; 0: not tried", m%n_motions)
      call t%integer("is_integrated_first", "1", "", "1 if time integration was tried before the balance", merge(1, 0, &
         m%is_integrated_first))
      call t%real_array("frequency", "rad/s", "tone", "base frequencies", m%frequency)
      call t%real_array("artificial_damping", "1/s", "tone", &
         "xi of a normal mode: the forces -xi M dx/dt that maintain its amplitude", m%artificial_damping)
   end subroutine outcome_columns

   !> Columns with a tolerance; the last one only for named outputs.
   subroutine accuracy_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_accuracy
      call t%integer("n_levels", "1", "", "number of sets and grids solved until the tolerance was met", m%n_levels)
      call t%real("level_difference", "1", "", "difference of the last two levels, relative to the motion", m%level_difference)
      call t%real("level_estimate", "1", "", &
         "estimated error from this difference, where it exceeds the other estimates; else 0", m%level_estimate)
      call t%integer_array("grid", "1", "tone", "samples of each tone", m%n_samples)
      t%is_there = t%has_accuracy .and. t%has_outputs
      call t%real_array("output_estimate", "1", "output", &
         "estimated relative error of each output of the tolerance", m%output_estimate)
      call t%real_array("output_level_estimate", "1", "output", &
         "estimated error of each output from the difference of levels, where larger; else 0", m%output_level_estimate)
   end subroutine accuracy_columns

   !> Columns of the motion; `tuples` if each point chooses its own, improved coefficients after steps of improvement.
   subroutine motion_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_own_tuples
      call t%integer_array("tuples", "1", "harmonic tone", &
         "integer tuple j of each harmonic of the point; only the first n_harmonics are in use", m%harmonics%tuples)
      t%is_there = .true.
      call t%real_array("coefficients", of_dof, "dof harmonic component", "coefficients of the motion", m%coefficients)
      call t%real_array("force_coefficients", of_force, "law_dof harmonic component", &
         "coefficients of the force of the laws, on the left-hand side", m%force_coefficients)
      call t%real_array("corrected_coefficients", of_dof, "law_dof harmonic component", &
         "coefficients of the displacement corrected at a rigid wall", m%corrected_coefficients)
      t%is_known = allocated(m%error_estimate%combination)
      call t%real_array("frequency_estimate", "rad/s", "tone", "estimated error of the frequencies, 0 for given ones", &
         m%error_estimate%frequency_error)
      t%is_known = .true.
      t%is_there = t%has_improved
      call t%real_array("improved_coefficients", of_dof, "law_dof harmonic component", &
         "coefficients of the motion improved in a wider set of harmonics", m%improved_coefficients)
      t%is_there = .true.
   end subroutine motion_columns

   subroutine error_estimate_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp) :: damping, loss, loss_factor

      loss = m%error_estimate%energy%lost
      if (allocated(m%error_estimate%power_laws)) loss = loss + sum(m%error_estimate%power_laws)
      t%is_known = allocated(m%error_estimate%combination)
      damping = 0.0_wp
      loss_factor = 0.0_wp
      if (t%is_known) damping = m%error_estimate%energy%decay(loss)
      if (t%is_known) loss_factor = m%error_estimate%energy%loss_factor(loss)
      associate (found => m%error_estimate)
         call t%real("truncation_estimate", "1", "", &
            "estimated truncation error, relative to the motion", found%truncation)
         call t%real("aliasing_estimate", "1", "", &
            "estimated aliasing error, relative to the motion", found%aliasing)
         call t%real("penetration", "m", "", "largest penetration into a rigid wall", found%defects%penetration)
         call t%real("impact_estimate", "1", "", &
            "energy of the strongest impact against a rigid wall, relative to that of the motion there", found%impact)
         call t%real("tension", "N", "", "largest tensile reaction of a rigid wall", found%defects%tension)
         call t%real("complementarity", "N m", "", "largest product of reaction and gap of a rigid wall", &
            found%defects%complementarity)
         call t%real("slip_defect", "W", "", &
            "largest power by which exact friction would exceed the reaction of rigid friction", found%defects%slip)
         call t%real("power_in", "W", "", "mean power of the loads", found%power_in)
         call t%real("power_damping", "W", "", "mean dissipation in the structure", found%energy%lost)
         call t%real_array("power_laws", "W", "law", "mean dissipation in each law", found%power_laws)
         call t%real_array("peak_force", "N", "law", "largest force of each law at a sample, over its coordinates", &
            found%peak_force)
         call t%real("energy_kinetic", "J", "", "mean kinetic energy of the structure", found%energy%kinetic)
         call t%real("energy_strain", "J", "", "mean strain energy of the structure", found%energy%strain)
         call t%real("loss_factor", "1", "", &
            "total dissipation over twice the sum of frequency times mean strain energy of each harmonic", loss_factor)
         call t%real("equivalent_damping", "1/s", "", "total dissipation over four times the mean kinetic energy", damping)
         call t%real("combination_frequency", "rad/s", "", "smallest |k.omega| of low order", found%combination_frequency)
         call t%integer_array("combination", "1", "tone", "integers k of combination_frequency", found%combination)
      end associate
      call t%integer("is_near_commensurate", "1", "", "1 if combination_frequency is below the threshold: "// &
         "the tones are nearly commensurate", merge(1, 0, m%is_near_commensurate))
      t%is_known = .true.
   end subroutine error_estimate_columns

   !> Exponents and multipliers if stability is requested; multipliers only for one tone.
   subroutine stability_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      real(wp), allocatable :: exponents(:), im(:), re(:)
      integer :: n

      n = t%n_multipliers
      associate (found => m%stability)
         if (allocated(found%exponents)) allocate (exponents, source=padded(found%exponents, n))
         if (allocated(found%exponents) .and. allocated(found%multipliers)) then
            allocate (re, source=padded(real(found%multipliers), n))
            allocate (im, source=padded(aimag(found%multipliers), n))
         end if
         call t%integer("is_stable", "1", "", "1 stable (small disturbances decay), -1 unstable, 0 unknown", found%verdict, &
                        ["unstable", "unknown ", "stable  "], lowest=-1)
         call t%integer("stability_reason", "1", "", "why the stability is not known", found%reason, unknown_because_names)
         call t%integer("n_unstable", "1", "", "number of growing disturbances", found%n_unstable)
         call t%integer("stability_method", "1", "", "method of the stability analysis", found%method, stability_method_names)
         t%is_known = allocated(exponents)
         call t%real("stability_estimate", trim(merge("1  ", "1/s", t%has_one_tone)), "", &
            "estimated relative error of the monodromy matrix; for several tones of the largest exponent", found%estimate)
         t%is_there = n > 0
         call t%real_array("exponent", "1/s", "multiplier", "growth rates of disturbances, the largest first", exponents)
         t%is_there = n > 0 .and. t%has_one_tone
         call t%real_array("multiplier_real", "1", "multiplier", "Floquet multipliers, the largest first: real parts", re)
         call t%real_array("multiplier_imag", "1", "multiplier", "Floquet multipliers, the largest first: imaginary parts", im)
      end associate
      t%is_there = .true.
      t%is_known = .true.
   end subroutine stability_columns

   !> Columns of what noise causes about the motion.
   subroutine noise_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      integer :: status

      t%is_there = t%has_noise
      associate (found => m%stability%response)
         status = found%status
         if (status == noise_status%none .and. is_solved(m%status)) status = noise_status%no_verdict
         call t%integer("noise_status", "1", "", "whether the response to noise is known, or why not", status, &
                        noise_status_names)
         call t%real_array("noise_variance", of_square, "dof", "variance due to noise about the motion: mean over a period", &
            found%variance)
         call t%real_array("noise_peak_variance", of_square, "dof", "largest variance due to noise in a period", found%peak)
         call t%real_array("noise_least_variance", of_square, "dof", "smallest variance due to noise in a period", found%least)
         t%is_known = found%status == noise_status%known
         call t%real("noise_estimate", "1", "", "estimated relative error of these variances", found%estimate)
         t%is_known = .true.
         call t%real_array("phase_diffusion", "rad2/s", "tone", &
            "rate of the variance of the phase due to noise; 0 for given tones", found%phase_diffusion)
         t%is_there = t%has_noise .and. t%has_noise_spectrum
         call t%real_array("noise_spectrum", of_square_by_rate, "dof", &
            "one-sided spectral density due to noise at noise_frequency, mean over a period", found%spectrum)
      end associate
      t%is_there = .true.
   end subroutine noise_columns

   !> Columns with derivatives.
   subroutine gradient_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_gradient .and. t%has_response_gradient
      call t%real_array("response_gradient", "1", "gradient_value", &
         "derivatives of the response with respect to input values, each in its unit", m%gradient%response)
      t%is_there = t%has_gradient .and. .not. t%has_response_gradient
      call t%real_array("gradient", "1", "gradient_value dof harmonic component", &
         "derivatives of the coefficients with respect to input values, each in its unit", m%gradient%coefficients)
      t%is_there = t%has_gradient
      call t%real_array("frequency_gradient", "1", "gradient_value tone", "derivatives of the base frequencies likewise", &
         m%gradient%frequency)
      call t%real_array("gradient_estimate", "1", "gradient_value", &
         "relative change of the derivatives with twice the samples and, with a tolerance, twice the set; nan: unknown", &
         m%gradient%estimate)
      call t%real_array("gradient_defect", "1", "gradient_value", &
         "deviation of the motion from the linear prediction at a small step; not small at a kink", m%gradient%defect)
      t%is_there = t%has_gradient .and. t%has_curve
      call t%real_array("position_gradient", "1", "gradient_value", &
         "derivatives of the position of a located point, such as a fold or peak; 0 at all others", &
         m%gradient%position)
      t%is_there = .true.
   end subroutine gradient_columns

   !> Columns of curves.
   subroutine curve_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m
      type(curve_position_t) :: position
      type(kind_attribute_t), allocatable :: attributes(:)
      integer :: i, n

      t%is_there = t%has_curve
      if (.not. t%is_there) return
      t%is_known = allocated(m%curve)
      if (t%is_known) position = m%curve
      n = 0
      if (allocated(position%unknowns)) n = size(position%unknowns)
      if (n > 0 .and. .not. t%has_own_tuples) position%unknowns = padded(position%unknowns, t%n_curve_unknowns)
      if (allocated(position%direction) .and. .not. t%has_own_tuples) &
         position%direction = padded(position%direction, t%n_curve_unknowns)
      call t%integer("curve_kind", "1", "", "kind of the point of a curve", position%kind, curve_kind_names)
      if (t%describes) then
         allocate (attributes, source=kind_attributes())
         do i = 1, size(attributes)
            call t%attribute(trim(attributes(i)%name), trim(attributes(i)%text))
         end do
      end if
      call t%integer("curve_branch", "1", "", &
         "number of the branch point from which this part of the curve starts, from 1; 0: from its start", position%branch)
      call t%real("curve_length", "1", "", "length of the curve from its start, "// &
         "in units of the range and of the largest motion; negative in the other direction", position%length)
      call t%integer("curve_response", "1", "", &
         "number of the response that is located there, of all keys that name responses together; 0: none", position%response)
      call t%integer("curve_extreme", "1", "", "1 at a maximum, -1 at a minimum, 2 at one of unknown sense, "// &
         "and at the end of a step that passed a fold which is not located; else 0", position%extreme)
      call t%real("curve_over", "1", "", "value of 'over' in its unit for continued located points, else 0", position%over)
      call t%integer("curve_n_unknowns", "1", "", "number of unknowns of the curve in use", n)
      call t%real_array("curve_unknowns", "1", "curve_unknown", "unknowns of the curve, the value last", position%unknowns)
      call t%real_array("curve_direction", "1", "curve_unknown", "tangent of the curve, where it continues from the point", &
         position%direction)
      call t%real("curve_step", "1", "", "length of the next step; 0 except at the end of a step", position%step)
      call t%real("curve_orientation", "1", "", &
         "sign of the determinant of the bordered tangent, at the end of a step; 0: unknown", position%orientation)
      call t%real("curve_largest_motion", "1", "", &
         "largest motion so far, at the end of a step, relative to a typical one: the unit of lengths", position%largest_motion)
      call t%integer("curve_unreliable_steps", "1", "", &
         "number of the last steps whose errors are too large to be estimated, at the end of a step", position%n_unreliable)
      call t%integer("curve_exhausted_steps", "1", "", &
         "number of the last steps that have used up the work of a point, at the end of a step", position%n_exhausted)
      call t%real("curve_angle", "rad", "", "angle of the multipliers at a period doubling or Neimark-Sacker point, else 0", &
                  position%angle)
      call t%real(t%curve_column, t%curve_units, "", "value of "//t%curve_path//" along the curve", position%parameter)
   end subroutine curve_columns

   !> Columns with samples.
   subroutine surface_columns(t, m)
      class(columns_t), intent(inout) :: t
      type(motion_result_t), intent(in) :: m

      t%is_there = t%has_surfaces
      t%is_known = .true.
      call t%real_array("displacement_samples", of_dof, "law_dof tau", "hypertime surface of the motion", m%displacement_samples)
      call t%real_array("corrected_samples", of_dof, "law_dof tau", "hypertime surface corrected at a rigid wall", &
         m%corrected_samples)
      call t%real_array("force_samples", of_force, "law_dof tau", "hypertime surface of the force", m%force_samples)
   end subroutine surface_columns

   !> Unit of a column of the table: the given one, or that which all degrees of freedom along it share, else `see dof_units`.
   pure subroutine find_shared_unit(units, dof_units, shared, list)
      character(*), intent(in) :: units                 !! of the table
      character(*), intent(in) :: dof_units(:)          !! of the degrees of freedom along the column
      character(:), allocatable, intent(out) :: shared
      character(:), allocatable, intent(out) :: list    !! of all of them, with blanks between; not allocated for other columns
      character(16) :: of_dofs(size(dof_units))
      integer :: i

      shared = units
      if (all(units /= [character(len(of_dof)) :: of_dof, of_force, of_rate, of_square, of_square_by_rate])) return
      of_dofs = dof_units
      do i = 1, size(of_dofs)
         if (units == of_force) of_dofs(i) = force_unit(of_dofs(i))
         if (units == of_rate) of_dofs(i) = trim(of_dofs(i))//"/s"
         if (units == of_square) of_dofs(i) = square_of(of_dofs(i))
         if (units == of_square_by_rate) of_dofs(i) = trim(square_of(of_dofs(i)))//"/Hz"
      end do
      list = trim(adjustl(join(of_dofs, " ")))
      shared = "see dof_units"
      if (size(of_dofs) == 0) then
         shared = "1"
      else if (all(of_dofs == of_dofs(1))) then
         shared = trim(of_dofs(1))
      end if
   end subroutine find_shared_unit

   !> Unit of a square.
   pure character(16) function square_of(unit)
      character(*), intent(in) :: unit

      square_of = trim(unit)//"2"
      if (unit == "1" .or. unit == "") square_of = "1"
   end function square_of

   !> Unit of the force that does work on a degree of freedom.
   pure character(16) function force_unit(unit)
      character(*), intent(in) :: unit

      select case (unit)
      case ("m"); force_unit = "N"
      case ("rad"); force_unit = "N*m"
      case ("1", ""); force_unit = "1"
      case default; force_unit = "J/"//unit
      end select
   end function force_unit

   !> The first `n` values, filled with NaN.
   pure function padded(values, n)
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n
      real(wp) :: padded(n)

      padded = ieee_value(1.0_wp, ieee_quiet_nan)
      padded(:min(n, size(values))) = values(:min(n, size(values)))
   end function padded
end module hb_motion_columns
