!> Another choice of base frequencies, in which a set of tuples needs fewer samples. With an integer matrix A of determinant 1 or
!> -1, the tuples A j and the frequencies A^-T omega have the same combinations, (A j).(A^-T omega) = j.omega, so that they
!> describe the same motions. The tuples of contact under several tones lie along a slow combination, a diagonal of their box;
!> where A turns it into an axis, the box, and the grid with it, is several times smaller.
module hb_base_change
   use hb_assert, only: assert, asserts_are_on
   use hb_characteristic, only: samples_along_time
   use hb_error, only: error_t
   use hb_error_estimate, only: near_commensurate
   use hb_estimated_errors, only: error_estimate_t
   use hb_harmonics, only: canonical_sign, harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_law, only: has_memory
   use hb_level, only: degree_of, level_t, needed_samples
   use hb_motion_result, only: motion_result_t
   use hb_options, only: options_t
   use hb_reduced_base, only: max_grid_ratio, may_change_base, min_grid, reduced_base
   use hb_system, only: system_t
   use hb_torus, only: fast_size
   implicit none
   private
   public :: base_change_t

   real(wp), parameter :: min_base_frequency_ratio = 1.0e-6_wp        ! base frequency, relative to the largest one

   type :: base_change_t
      logical :: is_on = .false.
      type(system_t) :: system                                        !! with the other base frequencies
      type(level_t) :: level
      integer, allocatable, private :: matrix(:, :), inverse(:, :)    ! A, (n_tones, n_tones)
   contains
      procedure :: choose => base_change_choose
      procedure :: bring_back => base_change_bring_back
   end type base_change_t

contains

   !> Chooses the base for a level, and puts system and level in it, if that saves samples.
   subroutine base_change_choose(self, system, options, level, guess)
      class(base_change_t), intent(out) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(level_t), intent(in) :: level
      real(wp), allocatable, intent(inout) :: guess(:)                !! unknowns of the level, if it is allocated
      real(wp), allocatable :: omega(:)
      integer, allocatable :: n_samples(:)
      type(error_t), allocatable :: error

      if (product(real(level%torus%n_samples, wp)) < min_grid) return
      if (.not. may_change_base(system, options)) return
      call reduced_base(level%harmonics%tuples, self%matrix, self%inverse)
      call make_positive(self, system%tones%omega, omega)
      if (minval(omega) < min_base_frequency_ratio*maxval(omega)) return
      allocate (n_samples, source=samples_in(self, system, level))
      if (has_memory(system%laws)) n_samples = samples_along_time(n_samples, omega)
      if (product(real(n_samples, wp)) > max_grid_ratio*product(real(level%torus%n_samples, wp))) return
      self%level%discretisation_t = level%discretisation_t
      call move_set(self%matrix, level%harmonics, self%level%harmonics, error)
      if (allocated(error)) return
      self%is_on = .true.
      call self%level%torus%resample(n_samples)
      self%system = system
      self%system%tones%omega = omega
      if (allocated(guess)) call turn(guess, level%harmonics, is_turned(self%matrix, level%harmonics), omega)
   end subroutine base_change_choose

   !> Brings a result back to the given base.
   subroutine base_change_bring_back(self, system, options, set, result, unknowns)
      class(base_change_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(options_t), intent(in) :: options
      type(harmonics_t), intent(in) :: set                            !! of the level, in the given base
      type(motion_result_t), intent(inout) :: result
      real(wp), allocatable, intent(inout) :: unknowns(:)
      logical :: turned(set%n_harmonics)

      turned = is_turned(self%matrix, set)
      if (allocated(result%frequency)) result%frequency = system%tones%omega
      call result%turn_harmonics(turned)
      if (allocated(unknowns)) call turn(unknowns, set, turned, system%tones%omega)
      call bring_estimate_back(self, system, result%error_estimate)
      result%is_near_commensurate = allocated(result%error_estimate%combination) .and. &
         result%error_estimate%combination_frequency < options%error_estimate%commensurability*maxval(system%tones%omega)
   end subroutine base_change_bring_back

   !> Error estimates name tuples: those of the wider set, and a combination of the tones.
   subroutine bring_estimate_back(self, system, estimate)
      class(base_change_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(error_estimate_t), intent(inout) :: estimate
      type(harmonics_t) :: around
      type(error_t), allocatable :: error
      logical, allocatable :: turned(:)
      integer :: h

      if (allocated(estimate%combination)) &
         call near_commensurate(system%tones, estimate%combination, estimate%combination_frequency)
      if (estimate%around%n_harmonics == 0) return
      allocate (turned, source=is_turned(self%inverse, estimate%around))
      call move_set(self%inverse, estimate%around, around, error)
      if (allocated(error)) then                                      ! too large a box: the next level grows without it
         if (allocated(estimate%neglected)) deallocate (estimate%neglected)
         if (allocated(estimate%first_order)) deallocate (estimate%first_order)
         return
      end if
      if (allocated(estimate%first_order)) then
         do h = 1, around%n_harmonics
            if (turned(h) .and. around%sin_at(h) > 0) &
               estimate%first_order(around%sin_at(h), :) = -estimate%first_order(around%sin_at(h), :)
         end do
      end if
      if (allocated(estimate%refined)) then
         do h = 1, around%n_harmonics
            if (turned(h)) estimate%refined(:, h) = conjg(estimate%refined(:, h))
         end do
      end if
      estimate%around = around
   end subroutine bring_estimate_back

   !> Turns rows of A so that all base frequencies are positive.
   pure subroutine make_positive(self, given, omega)
      class(base_change_t), intent(inout) :: self
      real(wp), intent(in) :: given(:)                                !! [rad/s]
      real(wp), allocatable, intent(out) :: omega(:)                  !! [rad/s]
      integer :: m

      if (asserts_are_on) call assert(size(given) == size(self%inverse, 1), "make_positive", "a frequency for each tone")
      allocate (omega, source=[(dot_product(given, self%inverse(:, m)), m=1, size(given))])
      do m = 1, size(omega)
         if (omega(m) >= 0.0_wp) cycle
         omega(m) = -omega(m)
         self%matrix(m, :) = -self%matrix(m, :)
         self%inverse(:, m) = -self%inverse(:, m)
      end do
   end subroutine make_positive

   !> Samples in the other base, as dense as those of the level.
   pure function samples_in(self, system, level) result(n_samples)
      class(base_change_t), intent(in) :: self
      type(system_t), intent(in) :: system
      type(level_t), intent(in) :: level
      integer, allocatable :: n_samples(:)
      integer :: highest(level%harmonics%n_tones)
      real(wp) :: density

      highest = maxval(abs(matmul(self%matrix, level%harmonics%tuples)), dim=2)
      density = product(level%torus%n_samples/(2.0_wp*level%harmonics%highest + 1.0_wp))**(1.0_wp/size(highest))
      n_samples = needed_samples(highest, degree_of(system))
      if (degree_of(system) == 0) n_samples = max(n_samples, fast_size(ceiling(density*(2*highest + 1))))
   end function samples_in

   !> The set of the tuples B j, in the order of j.
   subroutine move_set(matrix, set, moved, error)
      integer, intent(in) :: matrix(:, :)                             !! B
      type(harmonics_t), intent(in) :: set
      type(harmonics_t), intent(out) :: moved
      type(error_t), allocatable, intent(out) :: error

      call new_harmonics(moved, matmul(matrix, set%tuples), error)
      if (.not. allocated(error)) moved%units = matmul(matrix, set%units)
   end subroutine move_set

   !> Whether a moved set contains the negative of B j.
   pure function is_turned(matrix, set)
      integer, intent(in) :: matrix(:, :)
      type(harmonics_t), intent(in) :: set
      logical :: is_turned(set%n_harmonics)
      integer :: h

      is_turned = [(canonical_sign(matmul(matrix, set%tuples(:, h))) < 0, h=1, set%n_harmonics)]
   end function is_turned

   !> Changes the sign of sines of turned tuples among unknowns: coefficients at all coordinates, then the base frequencies.
   pure subroutine turn(unknowns, set, turned, omega)
      real(wp), intent(inout) :: unknowns(:)
      type(harmonics_t), intent(in) :: set                            !! both have the same positions
      logical, intent(in) :: turned(:)
      real(wp), intent(in) :: omega(:)                                !! [rad/s]
      integer :: first, h, n_all

      n_all = size(unknowns) - size(omega)
      do first = 0, n_all - 1, set%n_coefficients
         do h = 1, set%n_harmonics
            if (turned(h) .and. set%sin_at(h) > 0) unknowns(first + set%sin_at(h)) = 0.0_wp - unknowns(first + set%sin_at(h))
         end do
      end do
      unknowns(n_all + 1:) = omega
   end subroutine turn
end module hb_base_change
