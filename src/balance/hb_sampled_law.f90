!> One law with its samples on one torus: gathers its coordinates, evaluates it, scatters its force.
!> A law whose coordinate is a degree of freedom reads the samples of this one in place, and writes its force there if
!> no other law acts on it: each pass over the samples costs as much as a simple law.
!>
!> Source: docs/why/theory.md, sections 5.3 and 5.4.
module hb_sampled_law
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_characteristic, only: characteristic_t
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_hysteresis, only: hysteresis_t, new_hysteresis
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t, law_t
   use hb_law_samples, only: law_samples_t
   use hb_numbers, only: number_t
   implicit none
   private
   public :: new_sampled_law, sampled_law_t

   !> Owner of external resources: call `destroy`.
   type :: sampled_law_t
      class(law_t), pointer :: law => null()                          !! of `new_sampled_law`, which must outlive this
      integer, allocatable :: columns(:)                              !! coordinates on which it acts, as law%dofs
      logical :: reads_in_place = .false.                             !! z and v are samples of its degree of freedom
      logical :: writes_in_place = .false.                            !! f as well, and p
      real(wp), pointer, contiguous :: z(:, :) => null()              !! coordinates [m], (n_samples, n_coordinates)
      real(wp), pointer, contiguous :: v(:, :) => null()              !! their rates [m/s], as z or no columns
      real(wp), pointer, contiguous :: p(:, :) => null()              !! reaction [N], as z or no columns
      real(wp), pointer, contiguous :: f(:, :) => null()              !! forces [N], as z
      real(wp), allocatable :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :) !! last axis: the variable of differentiation
      type(hysteresis_t), allocatable :: hysteresis                   !! of a law with memory
      type(real_block_t), private :: own_z, own_v, own_p, own_f       ! if these are not in place
   contains
      procedure :: replace => sampled_law_replace
      procedure :: make_derivatives => sampled_law_make_derivatives
      procedure :: gather => sampled_law_gather
      procedure :: evaluate => sampled_law_evaluate
      procedure :: differentiate => sampled_law_differentiate
      procedure :: find_number_slope => sampled_law_find_number_slope
      procedure :: find_memory_slope => sampled_law_find_memory_slope
      procedure :: find_sides => sampled_law_find_sides
      procedure :: find_failure => sampled_law_find_failure
      procedure :: scatter => sampled_law_scatter
      procedure :: destroy => sampled_law_destroy
   end type sampled_law_t

contains

   !> Allocates memory for the samples of a law, but not for derivatives, see `make_derivatives`.
   subroutine new_sampled_law(self, law, is_alone, samples, characteristic, error)
      type(sampled_law_t), intent(inout) :: self
      class(law_t), pointer, intent(in) :: law
      logical, intent(in) :: is_alone                                 !! no other law acts on any of them
      type(law_samples_t), intent(in) :: samples
      type(characteristic_t), intent(in) :: characteristic            !! arbitrary for a law without memory
      type(error_t), allocatable, intent(out) :: error
      integer :: c

      call self%destroy()
      self%law => law
      self%columns = law%dofs
      c = size(law%shape, 2)
      self%reads_in_place = .false.
      if (size(law%shape) == 1) self%reads_in_place = law%shape(1, 1) == 1.0_wp
      self%writes_in_place = self%reads_in_place .and. is_alone
      call place(self%z, self%own_z, samples%q, self%reads_in_place, c)
      call place(self%v, self%own_v, samples%v, self%reads_in_place, merge(c, 0, law%needs_velocity))
      call place(self%p, self%own_p, samples%s, self%writes_in_place, merge(c, 0, law%is_multiplier))
      call place(self%f, self%own_f, samples%f, self%writes_in_place, c)
      if (allocated(error)) return
      select type (law)
      class is (hysteretic_law_t)
         allocate (self%hysteresis)
         call new_hysteresis(self%hysteresis, law, characteristic)
      end select

   contains

      !> Location of the samples: those of the only degree of freedom, or separate ones of the law.
      subroutine place(values, own, all_dofs, is_in_place, n_columns)
         real(wp), pointer, contiguous, intent(inout) :: values(:, :)
         type(real_block_t), intent(inout) :: own
         type(real_block_t), intent(in) :: all_dofs
         logical, intent(in) :: is_in_place
         integer, intent(in) :: n_columns

         if (allocated(error)) return
         if (is_in_place .and. n_columns > 0) then
            values => all_dofs%values(:, self%columns(1):self%columns(1))
         else
            call new_real_block(own, size(samples%q%values, 1), n_columns, error)
            values => own%values
         end if
      end subroutine place
   end subroutine new_sampled_law

   !> Takes another law of the same coordinates; a memory is that of rest.
   subroutine sampled_law_replace(self, law, characteristic)
      class(sampled_law_t), intent(inout) :: self
      class(law_t), pointer, intent(in) :: law                        !! differs from the present one in numbers alone
      type(characteristic_t), intent(in) :: characteristic            !! arbitrary for a law without memory

      self%law => law
      select type (law)
      class is (hysteretic_law_t)
         call new_hysteresis(self%hysteresis, law, characteristic)
      end select
   end subroutine sampled_law_replace

   !> Allocates the derivatives of a law without memory.
   subroutine sampled_law_make_derivatives(self)
      class(sampled_law_t), intent(inout) :: self

      associate (n => size(self%z, 1), c => size(self%z, 2))
         allocate (self%df_dz(n, c, c))
         allocate (self%df_dv(n, c, size(self%v, 2)))
         allocate (self%df_dp(n, c, size(self%p, 2)))
      end associate
   end subroutine sampled_law_make_derivatives

   !> Computes coordinates, their rates and the reaction from samples of the degrees of freedom of all laws.
   subroutine sampled_law_gather(self, samples)
      class(sampled_law_t), intent(inout) :: self
      type(law_samples_t), intent(in) :: samples
      integer :: c, k

      if (self%writes_in_place) return
      associate (shape => self%law%shape, columns => self%columns, q => samples%q, v => samples%v, s => samples%s, &
                 f => samples%f)
         do c = 1, merge(0, size(shape, 2), self%reads_in_place)
            self%z(:, c) = shape(1, c)*q%values(:, columns(1))
            do k = 2, size(columns)
               self%z(:, c) = self%z(:, c) + shape(k, c)*q%values(:, columns(k))
            end do
         end do
         if (size(self%v, 2) > 0 .and. .not. self%reads_in_place) then
            do c = 1, size(shape, 2)
               self%v(:, c) = shape(1, c)*v%values(:, columns(1))
               do k = 2, size(columns)
                  self%v(:, c) = self%v(:, c) + shape(k, c)*v%values(:, columns(k))
               end do
            end do
         end if
         if (size(self%p, 2) > 0) then
            self%p = 0.0_wp
            do c = 1, size(shape, 2)
               do k = 1, size(columns)
                  if (shape(k, c) == 0.0_wp) cycle
                  self%p(:, c) = self%p(:, c) + shape(k, c)/sum(shape(:, c)**2)* &
                                 (s%values(:, columns(k)) - f%values(:, columns(k)))
               end do
            end do
         end if
      end associate
   end subroutine sampled_law_gather

   !> Evaluates the force of a law without memory at the gathered coordinates.
   subroutine sampled_law_evaluate(self)
      class(sampled_law_t), intent(inout) :: self

      call self%law%evaluate(self%z, self%v, self%p, self%f)
   end subroutine sampled_law_evaluate

   !> Evaluates the force of a law without memory, and its derivatives, at the gathered coordinates.
   subroutine sampled_law_differentiate(self)
      class(sampled_law_t), intent(inout) :: self

      call self%law%evaluate(self%z, self%v, self%p, self%f, self%df_dz, self%df_dv, self%df_dp)
   end subroutine sampled_law_differentiate

   !> Derivative of the force of a law without memory by one of its numbers, at the gathered coordinates: that of the law,
   !> otherwise a difference.
   subroutine sampled_law_find_number_slope(self, number, steps, slope, is_known)
      class(sampled_law_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: steps(2)                                !! of the difference, as for `find_sides`
      real(wp), allocatable, intent(out) :: slope(:, :)               !! as f
      logical, intent(out) :: is_known                                !! the law has the number, and it can move by these steps
      type(law_box_t) :: sides(2)
      real(wp), allocatable :: lower(:, :)
      real(wp) :: value

      call self%law%find_number(number, value, is_known)
      if (.not. is_known) return
      allocate (slope, mold=self%f)
      call self%law%number_slope(number, self%z, self%v, self%p, slope, is_known)
      if (is_known) return
      call self%find_sides(number, steps, sides, is_known)
      if (.not. is_known) return
      allocate (lower, mold=slope)
      call sides(1)%law%evaluate(self%z, self%v, self%p, lower)
      call sides(2)%law%evaluate(self%z, self%v, self%p, slope)
      slope = (slope - lower)/sum(steps)
   end subroutine sampled_law_find_number_slope

   !> The same of a law with memory, after `evaluate`: a difference of its forces with the states of each side.
   subroutine sampled_law_find_memory_slope(self, number, steps, characteristic, samples, slope, is_known)
      class(sampled_law_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: steps(2)                                !! as for `find_sides`
      type(characteristic_t), intent(in) :: characteristic
      type(law_samples_t), intent(in) :: samples                      !! of the motion
      real(wp), allocatable, intent(out) :: slope(:, :)               !! as f
      logical, intent(out) :: is_known                                !! as for `find_number_slope`
      class(hysteretic_law_t), pointer :: of_side
      type(hysteresis_t), allocatable :: hysteresis
      type(law_box_t), target :: sides(2)
      real(wp), allocatable :: f(:, :, :)
      integer :: i

      call self%find_sides(number, steps, sides, is_known)
      if (.not. is_known) return
      allocate (f(size(self%f, 1), size(self%f, 2), 2))
      do i = 1, 2
         select type (law => sides(i)%law)
         class is (hysteretic_law_t)
            of_side => law
            allocate (hysteresis)
            call new_hysteresis(hysteresis, of_side, characteristic)
            call hysteresis%evaluate(characteristic, samples, f(:, :, i))
            is_known = is_known .and. hysteresis%sliders%repeats
            deallocate (hysteresis)
         class default
            is_known = .false.
         end select
         if (.not. is_known) return
      end do
      slope = (f(:, :, 2) - f(:, :, 1))/sum(steps)
   end subroutine sampled_law_find_memory_slope

   !> The law with a number that is smaller and larger by a step each.
   subroutine sampled_law_find_sides(self, number, steps, sides, are_possible)
      class(sampled_law_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in) :: steps(2)                                !! downwards and upwards; 0 at an end of the range
      type(law_box_t), intent(out) :: sides(2)
      logical, intent(out) :: are_possible                            !! they differ in numbers alone
      real(wp) :: value
      integer :: i

      call self%law%find_number(number, value, are_possible)
      are_possible = are_possible .and. sum(steps) > 0.0_wp
      do i = 1, 2
         if (.not. are_possible) return
         allocate (sides(i)%law, source=self%law)
         call sides(i)%law%set_number(number, value + (2*i - 3)*steps(i), are_possible)
         if (are_possible) are_possible = (sides(i)%law%needs_velocity .eqv. self%law%needs_velocity) .and. &
                                          (allocated(sides(i)%law%kinks) .eqv. allocated(self%law%kinks))
      end do
   end subroutine sampled_law_find_sides

   !> Stores the explanation of the law if its forces or derivatives are not finite, for the message of the point.
   subroutine sampled_law_find_failure(self, with_derivatives, error_text, is_given_up)
      class(sampled_law_t), intent(in) :: self
      logical, intent(in) :: with_derivatives
      character(:), allocatable, intent(inout) :: error_text          !! the first one is retained, unless this law cannot continue
      logical, intent(inout) :: is_given_up                           !! true if the law cannot continue
      character(:), allocatable :: text
      logical :: is_fatal, is_finite
      integer :: k

      is_finite = are_finite(self%f)
      if (with_derivatives) then
         do k = 1, size(self%f, 2)
            is_finite = is_finite .and. are_finite(self%df_dz(:, k, :)) .and. are_finite(self%df_dv(:, k, :)) .and. &
                        are_finite(self%df_dp(:, k, :))
         end do
      end if
      if (is_finite) return
      call self%law%explain(self%z, self%v, text, is_fatal)
      if (len(text) == 0) text = "forces or derivatives are not finite"
      if (is_fatal .or. .not. allocated(error_text)) error_text = "law '"//self%law%label//"': "//text
      is_given_up = is_fatal
   end subroutine sampled_law_find_failure

   !> Whether all values are finite; counting them without an early exit is vectorised.
   pure logical function are_finite(values)
      real(wp), intent(in) :: values(:, :)

      are_finite = count(ieee_is_finite(values)) == size(values)
   end function are_finite

   !> Adds the force of the law to those of its degrees of freedom.
   subroutine sampled_law_scatter(self, f)
      class(sampled_law_t), intent(in) :: self
      type(real_block_t), intent(inout) :: f                          !! [N], (n_samples, n_dofs)
      integer :: c, k

      if (self%writes_in_place) return
      associate (shape => self%law%shape)
         do c = 1, size(shape, 2)
            do k = 1, size(self%columns)
               f%values(:, self%columns(k)) = f%values(:, self%columns(k)) + shape(k, c)*self%f(:, c)
            end do
         end do
      end associate
   end subroutine sampled_law_scatter

   !> Frees the samples of the law; safe to call twice.
   subroutine sampled_law_destroy(self)
      class(sampled_law_t), intent(inout) :: self

      call self%own_z%destroy()
      call self%own_v%destroy()
      call self%own_p%destroy()
      call self%own_f%destroy()
      nullify (self%law, self%z, self%v, self%p, self%f)
   end subroutine sampled_law_destroy
end module hb_sampled_law
