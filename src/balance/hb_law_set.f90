!> All laws of a scene on the samples of one torus: total force and its derivatives at the degrees of freedom of the laws.
!>
!> Explicit laws come first; a multiplier law then sees the reaction p = s - (explicit forces) that equilibrium asks of it
!> at each sample, s = (loads - S u)(tau). Source: docs/theory.md, sections 5.3 and 5.4.
module hb_law_set
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_error, only: error_t
   use hb_fftw, only: new_real_block, real_block_t
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   implicit none
   private
   public :: law_dofs_of, law_set_t, new_law_set

   !> One law with its samples.
   type :: slot_t
      integer, allocatable :: columns(:)                              ! of its degrees of freedom among those of all laws
      real(wp), allocatable :: z(:, :), v(:, :), p(:, :), f(:, :)     ! (n_samples, n_coordinates, or no columns)
      real(wp), allocatable :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
   end type slot_t

   !> Owner of outside resources: call `destroy`.
   type :: law_set_t
      integer :: n_dofs = 0                                           !! degrees of freedom on which laws act
      integer :: n_pairs = 0                                          !! pairs (i, k) with d force_i/d motion_k not zero
      logical :: needs_velocity = .false.
      logical :: needs_reaction = .false.
      integer, allocatable :: row(:), column(:)                       !! (n_pairs) i and k of each pair
      type(law_box_t), allocatable :: laws(:)
      character(:), allocatable :: complaint                          !! why a law had no finite force so far
      logical :: is_given_up = .false.                                !! a law cannot go on: all forces are NaN from then on
      type(real_block_t) :: q, v, s, f                                !! motion, rate, reaction, force, (n_samples, n_dofs)
      type(real_block_t) :: df_dq, df_dv, df_ds                       !! (n_samples, n_pairs)
      type(slot_t), allocatable, private :: slots(:)
      integer, allocatable, private :: pair_at(:, :)                  ! (n_dofs, n_dofs), 0: no pair
      logical, private :: has_derivatives = .false.
   contains
      procedure :: columns_of => law_set_columns_of
      procedure :: evaluate => law_set_evaluate
      procedure :: differentiate => law_set_differentiate
      procedure :: correct => law_set_correct
      procedure :: contact_defects => law_set_contact_defects
      procedure :: mean_slopes => law_set_mean_slopes
      procedure :: destroy => law_set_destroy
   end type law_set_t

contains

   !> Degrees of freedom of the structure on which any law acts, ascending and once each.
   pure function law_dofs_of(laws) result(dofs)
      type(law_box_t), intent(in) :: laws(:)
      integer, allocatable :: dofs(:)
      logical, allocatable :: is_used(:)
      integer :: i, last

      last = 0
      do i = 1, size(laws)
         last = max(last, maxval(laws(i)%law%dofs))
      end do
      allocate (is_used(last), source=.false.)
      do i = 1, size(laws)
         is_used(laws(i)%law%dofs) = .true.
      end do
      dofs = pack([(i, i=1, last)], is_used)
   end function law_dofs_of

   !> Prepares the samples of all laws on a grid of `n_samples`. Derivatives get their memory at their first use.
   subroutine new_law_set(self, laws, n_samples, error)
      type(law_set_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)                          !! no two multipliers on one degree of freedom
      integer, intent(in) :: n_samples                                !! of the whole torus
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: dofs(:)
      integer :: c, i, k

      call self%destroy()
      self%has_derivatives = .false.
      self%needs_velocity = .false.
      self%needs_reaction = .false.
      self%is_given_up = .false.
      if (allocated(self%complaint)) deallocate (self%complaint)
      self%laws = laws
      dofs = law_dofs_of(laws)
      self%n_dofs = size(dofs)
      if (allocated(self%slots)) deallocate (self%slots)
      allocate (self%slots(size(laws)))
      do i = 1, size(laws)
         associate (law => laws(i)%law, slot => self%slots(i))
            slot%columns = [(findloc(dofs, law%dofs(k), dim=1), k=1, size(law%dofs))]
            c = size(law%shape, 2)
            self%needs_velocity = self%needs_velocity .or. law%needs_velocity
            self%needs_reaction = self%needs_reaction .or. law%is_multiplier
            allocate (slot%z(n_samples, c), slot%f(n_samples, c))
            allocate (slot%v(n_samples, merge(c, 0, law%needs_velocity)))
            allocate (slot%p(n_samples, merge(c, 0, law%is_multiplier)))
         end associate
      end do
      call find_pairs(self)
      call new_real_block(self%q, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      call new_real_block(self%f, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_velocity) call new_real_block(self%v, n_samples, self%n_dofs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%s, n_samples, self%n_dofs, error)
   end subroutine new_law_set

   !> Finds which forces depend on which motions. A multiplier law passes on what the explicit laws beside it depend on.
   subroutine find_pairs(self)
      type(law_set_t), intent(inout) :: self
      logical, allocatable :: coupled(:, :)
      integer :: a, b, i, pass

      allocate (coupled(self%n_dofs, self%n_dofs), source=.false.)
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(self%laws)
            if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            associate (columns => self%slots(i)%columns)
               do b = 1, size(columns)
                  do a = 1, size(columns)
                     coupled(columns(a), columns(b)) = .true.
                     if (pass == 2) coupled(columns(a), :) = coupled(columns(a), :) .or. coupled(columns(b), :)
                  end do
               end do
            end associate
         end do
      end do
      self%n_pairs = count(coupled)
      if (allocated(self%row)) deallocate (self%row, self%column, self%pair_at)
      allocate (self%row(self%n_pairs), self%column(self%n_pairs))
      allocate (self%pair_at(self%n_dofs, self%n_dofs), source=0)
      i = 0
      do b = 1, self%n_dofs
         do a = 1, self%n_dofs
            if (.not. coupled(a, b)) cycle
            i = i + 1
            self%row(i) = a
            self%column(i) = b
            self%pair_at(a, b) = i
         end do
      end do
   end subroutine find_pairs

   !> Where the degrees of freedom of law i stand among those of all laws.
   pure function law_set_columns_of(self, i) result(columns)
      class(law_set_t), intent(in) :: self
      integer, intent(in) :: i
      integer :: columns(size(self%slots(i)%columns))

      columns = self%slots(i)%columns
   end function law_set_columns_of

   !> Forces f from the samples q, v and s.
   subroutine law_set_evaluate(self)
      class(law_set_t), intent(inout) :: self

      call run_laws(self, with_derivatives=.false.)
   end subroutine law_set_evaluate

   !> Forces f and derivatives df_dq, df_dv, df_ds of all pairs from the samples q, v and s.
   subroutine law_set_differentiate(self, error)
      class(law_set_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error

      if (.not. self%has_derivatives) call allocate_derivatives(self, error)
      if (allocated(error)) return
      call run_laws(self, with_derivatives=.true.)
   end subroutine law_set_differentiate

   subroutine allocate_derivatives(self, error)
      class(law_set_t), intent(inout) :: self
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      n = size(self%q%values, 1)
      call new_real_block(self%df_dq, n, self%n_pairs, error)
      if (allocated(error)) return
      if (self%needs_velocity) call new_real_block(self%df_dv, n, self%n_pairs, error)
      if (allocated(error)) return
      if (self%needs_reaction) call new_real_block(self%df_ds, n, self%n_pairs, error)
      if (allocated(error)) return
      do i = 1, size(self%slots)
         associate (slot => self%slots(i))
            allocate (slot%df_dz(n, size(slot%z, 2), size(slot%z, 2)))
            allocate (slot%df_dv(n, size(slot%z, 2), size(slot%v, 2)))
            allocate (slot%df_dp(n, size(slot%z, 2), size(slot%p, 2)))
         end associate
      end do
      self%has_derivatives = .true.
   end subroutine allocate_derivatives

   subroutine run_laws(self, with_derivatives)
      class(law_set_t), intent(inout) :: self
      logical, intent(in) :: with_derivatives
      integer :: i, pass

      self%f%values = 0.0_wp
      if (with_derivatives) then
         self%df_dq%values = 0.0_wp
         if (self%needs_velocity) self%df_dv%values = 0.0_wp
         if (self%needs_reaction) self%df_ds%values = 0.0_wp
      end if
      if (self%is_given_up) then
         self%f%values = ieee_value(1.0_wp, ieee_quiet_nan)
         return
      end if
      do pass = 1, 2                                                   ! explicit laws, then multipliers
         do i = 1, size(self%laws)
            if (self%laws(i)%law%is_multiplier .neqv. pass == 2) cycle
            call gather(self, i)
            associate (law => self%laws(i)%law, slot => self%slots(i))
               if (with_derivatives) then
                  call law%evaluate(slot%z, slot%v, slot%p, slot%f, slot%df_dz, slot%df_dv, slot%df_dp)
                  if (law%is_multiplier) then
                     call add_multiplier_derivatives(self, i)
                  else
                     call add_explicit_derivatives(self, i)
                  end if
               else
                  call law%evaluate(slot%z, slot%v, slot%p, slot%f)
               end if
            end associate
            call listen(self, i, with_derivatives)
            call scatter(self, i)
         end do
      end do
   end subroutine run_laws

   !> Remembers what law i says when its forces or derivatives are not finite, for the message of the point.
   subroutine listen(self, i, with_derivatives)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      logical, intent(in) :: with_derivatives
      character(:), allocatable :: text
      logical :: is_fatal, is_finite

      associate (law => self%laws(i)%law, slot => self%slots(i))
         is_finite = all(ieee_is_finite(slot%f))
         if (with_derivatives) is_finite = is_finite .and. all(ieee_is_finite(slot%df_dz)) .and. &
                                           all(ieee_is_finite(slot%df_dv)) .and. all(ieee_is_finite(slot%df_dp))
         if (is_finite) return
         call law%explain(slot%z, slot%v, text, is_fatal)
         if (len(text) == 0) text = "forces or derivatives are not finite"
         if (is_fatal .or. .not. allocated(self%complaint)) self%complaint = "law '"//law%label//"': "//text
         self%is_given_up = is_fatal
      end associate
   end subroutine listen

   !> Coordinates, their rates and the reaction of law i from the samples of its degrees of freedom.
   subroutine gather(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: c, k

      associate (shape => self%laws(i)%law%shape, slot => self%slots(i))
         do c = 1, size(shape, 2)
            slot%z(:, c) = shape(1, c)*self%q%values(:, slot%columns(1))
            do k = 2, size(slot%columns)
               slot%z(:, c) = slot%z(:, c) + shape(k, c)*self%q%values(:, slot%columns(k))
            end do
         end do
         if (size(slot%v, 2) > 0) then
            do c = 1, size(shape, 2)
               slot%v(:, c) = shape(1, c)*self%v%values(:, slot%columns(1))
               do k = 2, size(slot%columns)
                  slot%v(:, c) = slot%v(:, c) + shape(k, c)*self%v%values(:, slot%columns(k))
               end do
            end do
         end if
         if (size(slot%p, 2) > 0) then
            slot%p(:, 1) = 0.0_wp
            do k = 1, size(slot%columns)
               slot%p(:, 1) = slot%p(:, 1) + shape(k, 1)/sum(shape(:, 1)**2)* &
                              (self%s%values(:, slot%columns(k)) - self%f%values(:, slot%columns(k)))
            end do
         end if
      end associate
   end subroutine gather

   !> Adds the force of law i to those of its degrees of freedom.
   subroutine scatter(self, i)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: i
      integer :: c, k

      associate (shape => self%laws(i)%law%shape, slot => self%slots(i))
         do c = 1, size(shape, 2)
            do k = 1, size(slot%columns)
               self%f%values(:, slot%columns(k)) = self%f%values(:, slot%columns(k)) + shape(k, c)*slot%f(:, c)
            end do
         end do
      end associate
   end subroutine scatter

   !> d force_i/d motion_k += sum over coordinates a, b of shape(i, a) df_a/dz_b shape(k, b), and the same for rates.
   subroutine add_explicit_derivatives(self, law)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: law
      integer :: a, b, i, k, pair
      real(wp) :: weight

      associate (shape => self%laws(law)%law%shape, slot => self%slots(law))
         do k = 1, size(slot%columns)
            do i = 1, size(slot%columns)
               pair = self%pair_at(slot%columns(i), slot%columns(k))
               do b = 1, size(shape, 2)
                  do a = 1, size(shape, 2)
                     weight = shape(i, a)*shape(k, b)
                     if (weight == 0.0_wp) cycle                       ! most of them where coordinates are degrees of freedom
                     self%df_dq%values(:, pair) = self%df_dq%values(:, pair) + weight*slot%df_dz(:, a, b)
                     if (size(slot%v, 2) > 0) then
                        self%df_dv%values(:, pair) = self%df_dv%values(:, pair) + weight*slot%df_dv(:, a, b)
                     end if
                  end do
               end do
            end do
         end do
      end associate
   end subroutine add_explicit_derivatives

   !> Chain rule through p = w.(s - f_explicit)/w.w for a law of one coordinate with weights w.
   !> Its degrees of freedom belong to no other multiplier, so what stands in their rows so far is explicit.
   subroutine add_multiplier_derivatives(self, law)
      class(law_set_t), intent(inout) :: self
      integer, intent(in) :: law
      integer :: i, k, own, pair
      real(wp) :: w_k
      real(wp), allocatable :: slope_q(:), slope_v(:)

      associate (w => self%laws(law)%law%shape(:, 1), slot => self%slots(law), df_dp => self%slots(law)%df_dp(:, 1, 1))
         do k = 1, self%n_dofs
            if (self%pair_at(slot%columns(1), k) == 0) cycle
            own = findloc(slot%columns, k, dim=1)
            w_k = 0.0_wp
            if (own > 0) w_k = w(own)
            slope_q = w_k*slot%df_dz(:, 1, 1) - df_dp*explicit_slope(self%df_dq%values, k)
            if (self%needs_velocity) slope_v = -df_dp*explicit_slope(self%df_dv%values, k)
            do i = 1, size(slot%columns)
               pair = self%pair_at(slot%columns(i), k)
               self%df_dq%values(:, pair) = self%df_dq%values(:, pair) + w(i)*slope_q
               if (self%needs_velocity) self%df_dv%values(:, pair) = self%df_dv%values(:, pair) + w(i)*slope_v
               self%df_ds%values(:, pair) = self%df_ds%values(:, pair) + w(i)*w_k/sum(w**2)*df_dp
            end do
         end do
      end associate

   contains

      !> w.(d f_explicit/d motion_k)/w.w
      function explicit_slope(derivative, k) result(slope)
         real(wp), intent(in) :: derivative(:, :)
         integer, intent(in) :: k
         real(wp) :: slope(size(derivative, 1))
         integer :: m

         slope = 0.0_wp
         associate (w => self%laws(law)%law%shape(:, 1), columns => self%slots(law)%columns)
            do m = 1, size(columns)
               slope = slope + w(m)/sum(w**2)*derivative(:, self%pair_at(columns(m), k))
            end do
         end associate
      end function explicit_slope
   end subroutine add_multiplier_derivatives

   !> Motion of the degrees of freedom as the laws allow it, from the samples q. A law of one coordinate z moves its degrees
   !> of freedom by w (corrected - z)/w.w.
   subroutine law_set_correct(self, corrected)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: corrected(:, :)                        !! [m], (n_samples, n_dofs)
      integer :: i, k

      corrected = self%q%values
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         call gather(self, i)
         associate (w => self%laws(i)%law%shape(:, 1), slot => self%slots(i))
            call self%laws(i)%law%correct(slot%z, slot%f)
            do k = 1, size(w)
               corrected(:, slot%columns(k)) = corrected(:, slot%columns(k)) + w(k)/sum(w**2)*(slot%f(:, 1) - slot%z(:, 1))
            end do
         end associate
      end do
   end subroutine law_set_correct

   !> Largest defects of all rigid contacts over the samples q and s, after `evaluate`.
   subroutine law_set_contact_defects(self, penetration, tension, complementarity)
      class(law_set_t), intent(inout) :: self
      real(wp), intent(out) :: penetration                            !! [m]
      real(wp), intent(out) :: tension                                !! [N]
      real(wp), intent(out) :: complementarity                        !! [N m]
      real(wp) :: of_one(3), of_all(3)
      integer :: i

      of_all = 0.0_wp
      do i = 1, size(self%laws)
         if (.not. self%laws(i)%law%is_multiplier) cycle
         call self%laws(i)%law%contact_defects(self%slots(i)%z, self%slots(i)%p, of_one(1), of_one(2), of_one(3))
         of_all = max(of_all, of_one)
      end do
      penetration = of_all(1)
      tension = of_all(2)
      complementarity = of_all(3)
   end subroutine law_set_contact_defects

   !> Means over the torus of df/dq, df/dv and df/ds, after `differentiate`.
   subroutine law_set_mean_slopes(self, df_dq, df_dv, df_ds)
      class(law_set_t), intent(in) :: self
      real(wp), intent(out) :: df_dq(:, :), df_dv(:, :), df_ds(:, :)  !! (n_dofs, n_dofs)
      integer :: i
      real(wp) :: weight

      df_dq = 0.0_wp
      df_dv = 0.0_wp
      df_ds = 0.0_wp
      weight = 1.0_wp/real(size(self%q%values, 1), wp)
      do i = 1, self%n_pairs
         associate (row => self%row(i), column => self%column(i))
            df_dq(row, column) = weight*sum(self%df_dq%values(:, i))
            if (self%needs_velocity) df_dv(row, column) = weight*sum(self%df_dv%values(:, i))
            if (self%needs_reaction) df_ds(row, column) = weight*sum(self%df_ds%values(:, i))
         end associate
      end do
   end subroutine law_set_mean_slopes

   !> Frees all samples; safe to call twice.
   subroutine law_set_destroy(self)
      class(law_set_t), intent(inout) :: self

      call self%q%destroy()
      call self%v%destroy()
      call self%s%destroy()
      call self%f%destroy()
      call self%df_dq%destroy()
      call self%df_dv%destroy()
      call self%df_ds%destroy()
   end subroutine law_set_destroy
end module hb_law_set
