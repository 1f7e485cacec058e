!> Locked tones: whether a time integration of a model with several tones ends in a periodic motion.
!>
!> If two tones lock, the motion is periodic, and there is no torus: a search for one diverges, or ends in harmonics
!> that the set does not contain. Time integration shows this. The record counts as periodic if multiples of one
!> frequency carry all of its power; a beat, however slow, reduces that share before its period is as long as twenty
!> records.
module hb_locking_search
   use hb_birkhoff, only: bump_weights, coefficients_at
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t
   use hb_frequency_analysis, only: find_frequencies
   use hb_integrated_start, only: change_of, first_perturbation, integrate_once, steady_power_change
   use hb_kinds, only: wp
   use hb_locking, only: highest_part, locking_t
   use hb_options, only: options_t
   use hb_system, only: system_t
   use hb_time_stepping, only: integration_record_t
   implicit none
   private
   public :: find_locking

   integer, parameter :: max_multiples = 80
   integer, parameter :: largest_structure = 64 ! degrees of freedom of models that are integrated automatically
   real(wp), parameter :: all_power = 1.0_wp - 1.0e-5_wp

contains

   !> Integrates, and searches for a common frequency of the motion. If time integration fails, or for a large
   !> structure, whose integration may take longer than the search did, the result is not known.
   subroutine find_locking(locking, system, discretisation, options, omega, law_dofs)
      type(locking_t), intent(out) :: locking
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones), as far as known, > 0
      integer, intent(in) :: law_dofs(:)
      type(integration_record_t) :: record
      type(error_t), allocatable :: error
      real(wp) :: leading
      integer :: part

      if (system%structure%n_dofs > largest_structure) return
      call integrate_once(system, discretisation, options, omega, law_dofs, first_perturbation, record, error)
      if (allocated(error) .or. record%is_at_rest) return
      if (change_of(record) > steady_power_change) return
      if (all(system%tones%is_unknown)) then
         call find_leading_line(record, leading, error)
         if (allocated(error) .or. leading <= 0.0_wp) return
      else
         leading = omega(findloc(system%tones%is_unknown, .false., dim=1))
      end if
      do part = 1, highest_part
         locking%base = leading/part
         locking%is_locked = share_of_multiples(record, locking%base, &
                                                maxval(abs(discretisation%harmonics%frequencies(omega)))) >= all_power
         if (locking%is_locked) exit
      end do
      if (locking%is_locked) locking%multiples = max(1, nint(omega/locking%base))
   end subroutine find_locking

   !> Frequency of the largest of all lines [rad/s]; 0 if nothing moves.
   subroutine find_leading_line(record, leading, error)
      type(integration_record_t), intent(in) :: record
      real(wp), intent(out) :: leading
      type(error_t), allocatable, intent(out) :: error
      complex(wp) :: amplitude(1)
      real(wp) :: frequency(1), largest
      integer :: k

      leading = 0.0_wp
      largest = 0.0_wp
      associate (x => record%every_displacement)
         do k = 1, size(x, 2)
            call find_frequencies(x(:, k) - sum(x(:, k))/size(x, 1), record%start, record%step, frequency, amplitude, error)
            if (allocated(error)) return
            if (.not. abs(amplitude(1)) > largest) cycle
            largest = abs(amplitude(1))
            leading = frequency(1)
         end do
      end associate
   end subroutine find_leading_line

   !> Share of the power of a record, without its mean, in multiples of one frequency up to the highest.
   real(wp) function share_of_multiples(record, base, highest) result(share)
      type(integration_record_t), intent(in) :: record
      real(wp), intent(in) :: base, highest                           !! [rad/s]
      complex(wp), allocatable :: c(:)
      real(wp), dimension(size(record%every_displacement, 1)) :: deviation, weights
      real(wp) :: all_of_it, explained
      integer :: i, k, n

      n = max(1, min(max_multiples, ceiling(highest/base)))
      allocate (c(n))
      all_of_it = 0.0_wp
      explained = 0.0_wp
      associate (x => record%every_displacement)
         weights = bump_weights(size(x, 1))
         do k = 1, size(x, 2)
            deviation = x(:, k) - sum(weights*x(:, k))
            call coefficients_at(deviation, record%start, record%step, [(i*base, i=1, n)], c)
            all_of_it = all_of_it + sum(weights*deviation**2)
            explained = explained + 0.5_wp*sum(abs(c)**2)
         end do
      end associate
      share = 0.0_wp
      if (all_of_it > 0.0_wp) share = explained/all_of_it
   end function share_of_multiples
end module hb_locking_search
