!> One law with its samples on one torus: gathers its coordinates, evaluates it, scatters its force.
!>
!> Source: docs/theory.md, sections 5.3 and 5.4.
module hb_law_slot
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_characteristic, only: characteristic_t
   use hb_fftw, only: real_block_t
   use hb_hysteretic_law, only: hysteretic_law_t
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_law_memory, only: law_memory_t, new_law_memory
   implicit none
   private
   public :: new_slot, slot_t

   !> The law itself is passed to each procedure; it is always the one of `new_slot`.
   type :: slot_t
      integer, allocatable :: columns(:)                              !! of its degrees of freedom among those of all laws
      real(wp), allocatable :: z(:, :), v(:, :), p(:, :), f(:, :)     !! (n_samples, n_coordinates, or no columns)
      real(wp), allocatable :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :) !! last axis: what is differentiated by
      type(law_memory_t), allocatable :: memory                       !! of a law that has one
   contains
      procedure :: make_derivatives => slot_make_derivatives
      procedure :: gather => slot_gather
      procedure :: evaluate => slot_evaluate
      procedure :: differentiate => slot_differentiate
      procedure :: listen => slot_listen
      procedure :: scatter => slot_scatter
   end type slot_t

contains

   !> Makes room for the samples of a law. Derivatives get theirs by `make_derivatives`.
   subroutine new_slot(self, law, columns, n_samples, characteristic)
      type(slot_t), intent(out) :: self
      class(law_t), intent(in) :: law
      integer, intent(in) :: columns(:)                               !! of its degrees of freedom among those of all laws
      integer, intent(in) :: n_samples
      type(characteristic_t), intent(in) :: characteristic            !! any for a law without memory
      integer :: c

      self%columns = columns
      c = size(law%shape, 2)
      allocate (self%z(n_samples, c), self%f(n_samples, c))
      allocate (self%v(n_samples, merge(c, 0, law%needs_velocity)))
      allocate (self%p(n_samples, merge(c, 0, law%is_multiplier)))
      select type (law)
      class is (hysteretic_law_t)
         allocate (self%memory)
         call new_law_memory(self%memory, law, characteristic)
      end select
   end subroutine new_slot

   !> Makes room for the derivatives of a law without memory.
   subroutine slot_make_derivatives(self)
      class(slot_t), intent(inout) :: self

      associate (n => size(self%z, 1), c => size(self%z, 2))
         allocate (self%df_dz(n, c, c))
         allocate (self%df_dv(n, c, size(self%v, 2)))
         allocate (self%df_dp(n, c, size(self%p, 2)))
      end associate
   end subroutine slot_make_derivatives

   !> Finds coordinates, their rates and the reaction from samples of the degrees of freedom of all laws.
   subroutine slot_gather(self, law, q, v, s, f)
      class(slot_t), intent(inout) :: self
      class(law_t), intent(in) :: law
      type(real_block_t), intent(in) :: q, v, s, f                    !! (n_samples, n_dofs); v, s empty where no law needs them
      integer :: c, k

      associate (shape => law%shape, columns => self%columns)
         do c = 1, size(shape, 2)
            self%z(:, c) = shape(1, c)*q%values(:, columns(1))
            do k = 2, size(columns)
               self%z(:, c) = self%z(:, c) + shape(k, c)*q%values(:, columns(k))
            end do
         end do
         if (size(self%v, 2) > 0) then
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
   end subroutine slot_gather

   !> Evaluates the force of a law without memory on what was gathered.
   subroutine slot_evaluate(self, law)
      class(slot_t), intent(inout) :: self
      class(law_t), intent(in) :: law

      call law%evaluate(self%z, self%v, self%p, self%f)
   end subroutine slot_evaluate

   !> Evaluates the force of a law without memory, and its derivatives, on what was gathered.
   subroutine slot_differentiate(self, law)
      class(slot_t), intent(inout) :: self
      class(law_t), intent(in) :: law

      call law%evaluate(self%z, self%v, self%p, self%f, self%df_dz, self%df_dv, self%df_dp)
   end subroutine slot_differentiate

   !> Remembers what the law says when its forces or derivatives are not finite, for the message of the point.
   subroutine slot_listen(self, law, with_derivatives, complaint, is_given_up)
      class(slot_t), intent(in) :: self
      class(law_t), intent(in) :: law
      logical, intent(in) :: with_derivatives
      character(:), allocatable, intent(inout) :: complaint           !! the first one stays, unless this law cannot go on
      logical, intent(inout) :: is_given_up                           !! true where the law cannot go on
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
      call law%explain(self%z, self%v, text, is_fatal)
      if (len(text) == 0) text = "forces or derivatives are not finite"
      if (is_fatal .or. .not. allocated(complaint)) complaint = "law '"//law%label//"': "//text
      is_given_up = is_fatal
   end subroutine slot_listen

   !> Whether all values are finite; counting them, with no way out at the first that is not, runs several at once.
   pure logical function are_finite(values)
      real(wp), intent(in) :: values(:, :)

      are_finite = count(ieee_is_finite(values)) == size(values)
   end function are_finite

   !> Adds the force of the law to those of its degrees of freedom.
   subroutine slot_scatter(self, law, f)
      class(slot_t), intent(in) :: self
      class(law_t), intent(in) :: law
      type(real_block_t), intent(inout) :: f                          !! [N], (n_samples, n_dofs)
      integer :: c, k

      associate (shape => law%shape)
         do c = 1, size(shape, 2)
            do k = 1, size(self%columns)
               f%values(:, self%columns(k)) = f%values(:, self%columns(k)) + shape(k, c)*self%f(:, c)
            end do
         end do
      end associate
   end subroutine slot_scatter
end module hb_law_slot
