!> The values of a motion by their names, for suites that compare them with stored ones.
module values_of_motion
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_accurate_motion, only: solve_to_tolerance
   use hb_error, only: error_t
   use hb_floquet, only: floquet_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_level, only: level_t
   use hb_model, only: model_t
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome_name
   use hb_text, only: to_text
   use messages, only: message_of
   use model_texts, only: law_example, law_place
   use models, only: make_model
   use named_values, only: named_values_t
   implicit none
   private
   public :: example, find_values

   integer, parameter :: exact = 8, rough = 2                          ! digits
   character(*), parameter :: stability_names(-1:1) = [character(8) :: "unstable", "unknown", "stable"]

contains

   !> Solves a model, by tolerance where it has one, and names its values: `cos` and `sin` of the first coordinate and of the
   !> last one at the tones, norms of all coefficients, powers [W], the energy [J], estimated errors, the largest multiplier and
   !> exponent.
   subroutine find_values(text, found, failure)
      character(*), intent(in) :: text                                !! of the model
      type(named_values_t), intent(out) :: found
      character(:), allocatable, intent(out) :: failure               !! why there is no motion; empty: there is one
      type(error_t), allocatable :: error
      type(level_t) :: top
      type(model_t) :: model
      type(motion_result_t) :: result

      call make_model(text, model, error)
      if (.not. allocated(error)) then
         call set_budget_of_stability(model)
         if (model%options%accuracy%is_on) then
            call solve_to_tolerance(model, result, error, top)
         else
            call solve_motion(model, result, error)
         end if
      end if
      failure = message_of(error)
      if (failure == "" .and. .not. allocated(result%coefficients)) failure = trim(outcome_name(result%status))//", no motion"
      if (failure /= "") return
      call found%add("status", trim(outcome_name(result%status)))
      call found%add("stability", trim(stability_names(result%stability%verdict)))
      call found%add("unstable", result%stability%n_unstable)
      call found%add("stuck", result%n_full_stick)
      call add_motion(found, model, result)
      call add_estimates(found, result)
   end subroutine find_values

   !> Values do not depend on what stability may cost by default.
   subroutine set_budget_of_stability(model)
      type(model_t), intent(inout) :: model

      associate (options => model%options)
         options%stability%patience = merge(6.0_wp, 1.0_wp, options%accuracy%is_on)
         select type (finder => options%callbacks%stability_finder)
         class is (floquet_t)
            finder%work_in_any_case = 0.0_wp
         end select
      end associate
   end subroutine set_budget_of_stability

   subroutine add_motion(found, model, result)
      type(named_values_t), intent(inout) :: found
      type(model_t), intent(in) :: model
      type(motion_result_t), intent(in) :: result
      type(harmonics_t) :: set
      integer :: h, i, last, m
      integer :: tuple(model%system%tones%n_tones)
      real(wp) :: energy, motion

      set = model%discretisation%harmonics
      if (result%harmonics%n_harmonics > 0) set = result%harmonics
      motion = norm2(result%coefficients)
      call found%add("motion", motion, motion, exact)
      last = size(result%coefficients, 3)
      do m = 0, model%system%tones%n_tones
         tuple = [(merge(1, 0, i == m), i=1, size(tuple))]
         h = set%index_of(tuple)
         if (h == 0) cycle
         call found%add(numbered("cos", m), result%coefficients(1, h, 1), motion, exact)
         if (m > 0) call found%add(numbered("sin", m), result%coefficients(2, h, 1), motion, exact)
         if (last > 1) call found%add(numbered("last_cos", m), result%coefficients(1, h, last), motion, exact)
         if (last > 1 .and. m > 0) call found%add(numbered("last_sin", m), result%coefficients(2, h, last), motion, exact)
      end do
      do m = 1, model%system%tones%n_tones
         if (model%system%tones%is_unknown(m)) &
            call found%add(numbered("frequency", m), result%frequency(m), result%frequency(m), exact)
      end do
      associate (error_estimate => result%error_estimate)
         energy = error_estimate%energy%kinetic
         call found%add("kinetic", energy, energy, exact)
         energy = max(abs(error_estimate%power_in), abs(error_estimate%energy%lost), 1.0e-4_wp*energy*maxval(abs(result%frequency)))
         call found%add("power", error_estimate%power_in, energy, exact)
         call found%add("lost", error_estimate%energy%lost, energy, exact)
         if (allocated(error_estimate%power_laws)) &
            call found%add("lost_in_laws", sum(error_estimate%power_laws), energy, exact)
      end associate
      if (allocated(result%force_coefficients)) call add_norm("force", result%force_coefficients)
      if (allocated(result%corrected_coefficients)) call add_norm("corrected", result%corrected_coefficients)
      if (allocated(result%improved_coefficients)) call add_norm("improved", result%improved_coefficients)
      if (allocated(result%displacement_samples)) &
         call found%add("samples", norm2(result%displacement_samples), norm2(result%displacement_samples), exact)
      if (allocated(result%force_samples)) &
         call found%add("force_samples", norm2(result%force_samples), norm2(result%force_samples), exact)
      if (allocated(result%outputs)) call found%add("output", norm2(abs(result%outputs)), norm2(abs(result%outputs)), exact)
      if (allocated(result%gradient%coefficients)) then
         do i = 1, size(result%gradient%coefficients, 4)
            call add_norm("slope_"//to_text(i), result%gradient%coefficients(:, :, :, i))
         end do
      end if

   contains

      subroutine add_norm(name, values)
         character(*), intent(in) :: name
         real(wp), intent(in) :: values(:, :, :)

         call found%add(name, norm2(values), norm2(values), exact)
      end subroutine add_norm
   end subroutine add_motion

   !> Those below a billionth are rounding errors alone.
   subroutine add_estimates(found, result)
      type(named_values_t), intent(inout) :: found
      type(motion_result_t), intent(in) :: result

      associate (error_estimate => result%error_estimate, stability => result%stability)
         call add_estimate("truncation", error_estimate%truncation)
         call add_estimate("aliasing", error_estimate%aliasing)
         call add_estimate("impact", error_estimate%impact)
         call add_estimate("penetration", error_estimate%defects%penetration)
         if (allocated(error_estimate%frequency_error)) call add_estimate("frequency_error", maxval(error_estimate%frequency_error))
         call add_estimate("level_difference", result%level_difference)
         call add_estimate("level_estimate", result%level_estimate)
         if (allocated(stability%multipliers)) call found%add("multiplier", maxval(abs(stability%multipliers)), 1.0_wp, 4)
         if (allocated(stability%exponents)) call found%add("exponent", maxval(stability%exponents), 0.1_wp, 3)
      end associate

   contains

      subroutine add_estimate(name, value)
         character(*), intent(in) :: name
         real(wp), intent(in) :: value

         if (ieee_is_finite(value)) then
            call found%add(name, value, max(value, 1.0e-9_wp), rough)
         else
            call found%add(name, value, 1.0_wp, rough)
         end if
      end subroutine add_estimate
   end subroutine add_estimates

   !> Name of a value at a tone: cos, cos_2, and mean of no tone.
   function numbered(name, tone) result(text)
      character(*), intent(in) :: name
      integer, intent(in) :: tone
      character(:), allocatable :: text

      text = name
      if (tone == 0) text = trim(merge("last_mean", "mean     ", index(name, "last") == 1))
      if (tone > 1) text = name//"_"//to_text(tone)
   end function numbered

   !> Group of the example of a law.
   function example(name) result(text)
      character(*), intent(in) :: name
      character(:), allocatable :: text

      text = "&law type='"//name//"' "//law_place(name)//" "//law_example(name)//" / "
   end function example
end module values_of_motion
