!> Kinks of the laws of a model between the samples of one torus: corrections of the sampling errors of their forces.
!> A law provides the positions of its kinks; their correction depends on the samples alone, see hb_kinks. Laws that
!> share a degree of freedom with a multiplier law are not corrected: while the multiplier is active, it compensates
!> their kinks. Source: docs/why/theory.md, section 5.7.
module hb_law_kinks
   use hb_fftw, only: real_block_t
   use hb_kinds, only: wp
   use hb_kinks, only: kink_grid_t, kink_slopes_t, new_kink_grid
   use hb_law, only: kink_t, law_t
   use hb_law_jacobian, only: law_jacobian_t
   use hb_law_samples, only: law_samples_t
   use hb_sampled_law, only: sampled_law_t
   use hb_torus, only: torus_t
   implicit none
   private
   public :: law_kinks_t, new_law_kinks

   !> One coordinate with kinks: z = sum of motion weights times degrees of freedom; the force acts on these with the
   !> force weights.
   type :: kinked_line_t
      integer :: law = 0, i = 0                                       !! number of its law, and of the kink there
      integer, allocatable :: columns(:)                              !! degrees of freedom among those of all laws
      real(wp), allocatable :: motion(:), force(:)                    !! (columns)
      type(kink_t) :: kink
      type(kink_slopes_t) :: slopes                                   !! after `correct` with derivatives
   end type kinked_line_t

   type :: law_kinks_t
      type(kinked_line_t), allocatable :: lines(:)                    !! none if kinks are not corrected
      type(kink_grid_t) :: grid
      real(wp), allocatable, private :: z(:), f(:)                    ! (n_samples)
   contains
      procedure :: correct => law_kinks_correct
      procedure :: are_met => law_kinks_are_met
      procedure :: fill_part => law_kinks_fill_part
      procedure :: add_own_slopes => law_kinks_add_own_slopes
      procedure :: add_along => law_kinks_add_along
      procedure :: add_of => law_kinks_add_of
   end type law_kinks_t

contains

   !> Collects the kinks of all laws.
   subroutine new_law_kinks(self, laws, torus)
      type(law_kinks_t), intent(out) :: self
      type(sampled_law_t), intent(in) :: laws(:)
      type(torus_t), intent(in) :: torus
      integer :: i, k, n

      allocate (self%lines(0))
      if (.not. torus%corrects_kinks) return
      n = sum([(n_lines(i), i=1, size(laws))])
      if (n == 0) return
      deallocate (self%lines)
      allocate (self%lines(n))
      n = 0
      do i = 1, size(laws)
         do k = 1, n_lines(i)
            n = n + 1
            associate (line => self%lines(n), law => laws(i)%law)
               line%columns = laws(i)%columns
               line%law = i
               line%i = k
               line%kink = law%kinks(k)
               line%motion = matmul(law%shape, line%kink%functional)
               line%force = matmul(law%shape, line%kink%direction)
            end associate
         end do
      end do
      call new_kink_grid(self%grid, torus)
      allocate (self%z(torus%n_total), self%f(torus%n_total))

   contains

      !> Combinations of coordinates of law i with kinks that need a correction.
      pure integer function n_lines(i)
         integer, intent(in) :: i
         integer :: k, m

         n_lines = 0
         if (.not. allocated(laws(i)%law%kinks)) return
         if (laws(i)%law%is_multiplier) return
         n_lines = size(laws(i)%law%kinks)
         do m = 1, size(laws)
            if (.not. laws(m)%law%is_multiplier) cycle
            if (any([(any(laws(m)%columns == laws(i)%columns(k)), k=1, size(laws(i)%columns))])) n_lines = 0
         end do
      end function n_lines
   end subroutine new_law_kinks

   !> Adds the corrections to the forces; with derivatives also stores their dependence on the motion.
   subroutine law_kinks_correct(self, samples, with_derivatives)
      class(law_kinks_t), intent(inout) :: self
      type(law_samples_t), intent(inout) :: samples
      logical, intent(in) :: with_derivatives
      integer :: i, k

      do i = 1, size(self%lines)
         associate (line => self%lines(i), f => samples%f%values)
            call combine(line, samples%q, self%z)
            self%f = 0.0_wp
            call line%slopes%forget()
            if (with_derivatives) then
               call self%grid%correct(self%z, line%kink%positions, line%kink%jumps, self%f, line%slopes)
            else
               call self%grid%correct(self%z, line%kink%positions, line%kink%jumps, self%f)
            end if
            do k = 1, size(line%columns)
               f(:, line%columns(k)) = f(:, line%columns(k)) + line%force(k)*self%f
            end do
         end associate
      end do
   end subroutine law_kinks_correct

   !> Adds the corrections that the force of law i would have with the kinks of another law in its place, times a factor.
   subroutine law_kinks_add_of(self, i, law, factor, samples, f)
      class(law_kinks_t), intent(inout) :: self
      integer, intent(in) :: i
      class(law_t), intent(in) :: law                                 !! differs from law i in numbers alone
      real(wp), intent(in) :: factor
      type(law_samples_t), intent(in) :: samples
      type(real_block_t), intent(inout) :: f                          !! (n_samples, n_dofs)
      type(kinked_line_t) :: line
      integer :: k, n

      do n = 1, size(self%lines)
         if (self%lines(n)%law /= i) cycle
         line%columns = self%lines(n)%columns
         line%kink = law%kinks(self%lines(n)%i)
         line%motion = matmul(law%shape, line%kink%functional)
         line%force = matmul(law%shape, line%kink%direction)
         call combine(line, samples%q, self%z)
         self%f = 0.0_wp
         call self%grid%correct(self%z, line%kink%positions, line%kink%jumps, self%f)
         do k = 1, size(line%columns)
            f%values(:, line%columns(k)) = f%values(:, line%columns(k)) + factor*line%force(k)*self%f
         end do
      end do
   end subroutine law_kinks_add_of

   !> Samples of the coordinate of a line.
   subroutine combine(line, q, z)
      type(kinked_line_t), intent(in) :: line
      type(real_block_t), intent(in) :: q
      real(wp), intent(out) :: z(:)
      integer :: k

      z = line%motion(1)*q%values(:, line%columns(1))
      do k = 2, size(line%columns)
         z = z + line%motion(k)*q%values(:, line%columns(k))
      end do
   end subroutine combine

   !> Whether the motion passed a kink, after `correct` with derivatives.
   pure logical function law_kinks_are_met(self)
      class(law_kinks_t), intent(in) :: self
      integer :: i

      law_kinks_are_met = any([(self%lines(i)%slopes%n > 0, i=1, size(self%lines))])
   end function law_kinks_are_met

   !> Response of the force of line i at all samples to the coordinate at neighbour number `part` of them.
   subroutine law_kinks_fill_part(self, i, part, samples, is_any)
      class(law_kinks_t), intent(in) :: self
      integer, intent(in) :: i
      integer, intent(in) :: part                                     !! 1 to grid%n_parts
      real(wp), intent(out) :: samples(:)                             !! [N/m], (n_samples)
      logical, intent(out) :: is_any                                  !! false: all are zero
      integer :: k

      is_any = .false.
      samples = 0.0_wp
      associate (slopes => self%lines(i)%slopes)
         do k = 1, slopes%n
            samples(slopes%row(k)) = slopes%value(part, k)
            is_any = is_any .or. abs(slopes%value(part, k)) > 0.0_wp
         end do
      end associate
   end subroutine law_kinks_fill_part

   !> Adds the response of forces to the motion at the same sample to the derivatives of the pairs.
   subroutine law_kinks_add_own_slopes(self, jacobian)
      class(law_kinks_t), intent(in) :: self
      type(law_jacobian_t), intent(inout) :: jacobian
      integer :: a, b, i, k, pair
      real(wp) :: weight

      do i = 1, size(self%lines)
         associate (line => self%lines(i), slopes => self%lines(i)%slopes)
            do b = 1, size(line%columns)
               do a = 1, size(line%columns)
                  pair = jacobian%pair_at(line%columns(a), line%columns(b))
                  weight = line%force(a)*line%motion(b)
                  do k = 1, slopes%n
                     associate (slope => jacobian%df_dq%values(slopes%row(k), pair))
                        slope = slope + weight*slopes%value(0, k)
                     end associate
                  end do
               end do
            end do
         end associate
      end do
   end subroutine law_kinks_add_own_slopes

   !> Adds the derivative of the forces along a direction, for the motion at the neighbours of each sample, to its
   !> `f`; `add_own_slopes` adds the rest.
   subroutine law_kinks_add_along(self, along)
      class(law_kinks_t), intent(in) :: self
      type(law_samples_t), intent(inout) :: along
      real(wp) :: response
      integer :: a, b, i, k, part

      do i = 1, size(self%lines)
         associate (line => self%lines(i), slopes => self%lines(i)%slopes, f => along%f%values, q => along%q%values)
            do b = 1, size(line%columns)
               do a = 1, size(line%columns)
                  associate (weight => line%force(a)*line%motion(b), to => line%columns(a), from => line%columns(b))
                     do k = 1, slopes%n                               ! few of the samples are beside a kink
                        response = 0.0_wp
                        do part = 1, self%grid%n_parts
                           associate (column => slopes%column(part, k))
                              response = response + slopes%value(part, k)*sign(1, column)*q(abs(column), from)
                           end associate
                        end do
                        f(slopes%row(k), to) = f(slopes%row(k), to) + weight*response
                     end do
                  end associate
               end do
            end do
         end associate
      end do
   end subroutine law_kinks_add_along
end module hb_law_kinks
