!> The laws of a model at one moment: their coordinates, forces and states.
!>
!> The coordinates of all laws follow one another, z = S^T q; a force f on them acts as S f on the structure, on the
!> left-hand side. Rigid laws have no force here: they need a method that supports constraints (hb_rigid_constraints).
module hb_integration_laws
   use hb_hysteretic_law, only: hysteretic_law_t, n_path_parts, path_part
   use hb_kinds, only: int64, wp
   use hb_law, only: law_box_t
   implicit none
   private
   public :: integration_laws_t, new_integration_laws

   !> Position of one law in the lists of all, and its arguments as arrays of one sample.
   type :: span_t
      integer :: first = 0, last = 0                                  !! coordinates
      integer :: first_state = 1, last_state = 0
      integer :: first_switch = 1, last_switch = 0
      logical :: is_held_back = .false.                               !! rigid
      real(wp), allocatable :: z(:, :), v(:, :), p(:, :), f(:, :)
      real(wp), allocatable :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp), allocatable :: path(:, :, :), s_old(:, :), s_new(:, :)   !! of a law with memory
      real(wp), allocatable :: df_ds(:, :, :), ds_ds_old(:, :, :), ds_dpath(:, :, :, :)
   end type span_t

   type :: integration_laws_t
      integer :: n_coordinates = 0
      integer :: n_states = 0
      integer :: n_switches = 0
      type(law_box_t), allocatable :: laws(:)
      type(span_t), allocatable :: spans(:)                           !! as laws
      real(wp), allocatable :: shape(:, :)                            !! S, (n_dofs, n_coordinates)
      real(wp), allocatable :: z(:), z_rate(:)                        !! after `gather`, (n_coordinates)
      real(wp), allocatable :: z_start(:), z_rate_start(:)            !! at the start of the step
      real(wp), allocatable :: f(:)                                   !! forces [N], (n_coordinates)
      real(wp), allocatable :: s_start(:), s(:)                       !! states at the start of the step and now, (n_states)
      real(wp) :: time_start = 0.0_wp                                 !! of the step [s]
      integer(int64) :: n_evaluations = 0_int64 !! number of evaluations of a motion: the cost of a time integration
      integer(int64) :: max_evaluations = huge(1_int64)              !! after which the equations stop
      real(wp), allocatable :: omega(:)                               !! tones whose phases laws need [rad/s]
      logical :: has_turning = .false.                                !! whether a law needs a phase
   contains
      procedure :: gather => laws_gather
      procedure :: coordinates_of => laws_coordinates_of
      procedure :: forces_of => laws_forces_of
      procedure :: start_step => laws_start_step
      procedure :: set_time => laws_set_time
      procedure :: evaluate => laws_evaluate
      procedure :: differentiate => laws_differentiate
      procedure :: has_rigid => laws_has_rigid
      procedure :: switch_values => laws_switch_values
      procedure :: switches_here => laws_switches_here
      procedure :: coordinate_labels => laws_coordinate_labels
   end type integration_laws_t

contains

   !> Assigns each law of a model its positions among the coordinates, states and switches of all, and memory for one
   !> sample.
   subroutine new_integration_laws(self, laws, n_dofs, omega)
      type(integration_laws_t), intent(out) :: self
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: n_dofs
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s]
      integer :: c, i, m

      self%laws = laws
      self%omega = omega
      allocate (self%spans(size(laws)))
      do i = 1, size(laws)
         associate (span => self%spans(i), law => self%laws(i)%law)
            c = size(law%shape, 2)
            span%first = self%n_coordinates + 1
            span%last = self%n_coordinates + c
            span%is_held_back = law%is_multiplier
            self%has_turning = self%has_turning .or. law%n_phases > 0
            if (law%needs_frequencies) call law%set_frequencies(omega)
            span%first_switch = self%n_switches + 1
            self%n_switches = self%n_switches + law%n_switches
            span%last_switch = self%n_switches
            self%n_coordinates = span%last
            allocate (span%z(1, c), span%v(1, merge(c, 0, law%needs_velocity)), span%p(1, 0), span%f(1, c))
            allocate (span%df_dz(1, c, c), span%df_dv(1, c, size(span%v, 2)), span%df_dp(1, c, 0))
            m = law%n_states
            span%first_state = self%n_states + 1
            span%last_state = self%n_states + m
            self%n_states = span%last_state
            if (m == 0) cycle
            allocate (span%path(1, c, n_path_parts), span%s_old(1, m), span%s_new(1, m))
            allocate (span%df_ds(1, c, m), span%ds_ds_old(1, m, m), span%ds_dpath(1, m, c, n_path_parts))
         end associate
      end do
      allocate (self%shape(n_dofs, self%n_coordinates), source=0.0_wp)
      do i = 1, size(laws)
         associate (law => self%laws(i)%law, span => self%spans(i))
            self%shape(law%dofs, span%first:span%last) = law%shape
         end associate
      end do
      c = self%n_coordinates
      allocate (self%z(c), self%z_rate(c), self%z_start(c), self%z_rate_start(c), self%f(c), source=0.0_wp)
      allocate (self%s(self%n_states), self%s_start(self%n_states), source=0.0_wp)
   end subroutine new_integration_laws

   !> Coordinates and their rates of a motion.
   pure subroutine laws_gather(self, q, v)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in), contiguous :: q(:), v(:)                  !! [m], [m/s], (n_dofs)
      integer :: c, i, k

      self%n_evaluations = self%n_evaluations + 1_int64
      do i = 1, size(self%spans)
         associate (law => self%laws(i)%law, first => self%spans(i)%first)
            do c = 1, size(law%shape, 2)
               self%z(first + c - 1) = 0.0_wp
               self%z_rate(first + c - 1) = 0.0_wp
               do k = 1, size(law%dofs)
                  self%z(first + c - 1) = self%z(first + c - 1) + law%shape(k, c)*q(law%dofs(k))
                  self%z_rate(first + c - 1) = self%z_rate(first + c - 1) + law%shape(k, c)*v(law%dofs(k))
               end do
            end do
         end associate
      end do
   end subroutine laws_gather

   !> S^T q, coordinates of displacements or rates.
   pure function laws_coordinates_of(self, q) result(z)
      class(integration_laws_t), intent(in) :: self
      real(wp), intent(in) :: q(:)                                    !! (n_dofs)
      real(wp) :: z(self%n_coordinates)
      integer :: i

      do i = 1, size(self%spans)
         associate (law => self%laws(i)%law, span => self%spans(i))
            z(span%first:span%last) = matmul(q(law%dofs), law%shape)
         end associate
      end do
   end function laws_coordinates_of

   !> S f, forces on the structure of forces on the coordinates.
   pure function laws_forces_of(self, f) result(forces)
      class(integration_laws_t), intent(in) :: self
      real(wp), intent(in) :: f(:)                                    !! [N], (n_coordinates)
      real(wp) :: forces(size(self%shape, 1))                         !! [N], (n_dofs)
      integer :: i

      forces = 0.0_wp
      do i = 1, size(self%spans)
         associate (law => self%laws(i)%law, span => self%spans(i))
            forces(law%dofs) = forces(law%dofs) + matmul(law%shape, f(span%first:span%last))
         end associate
      end do
   end function laws_forces_of

   !> Sets the phase of laws that rotate with a tone. `evaluate` and `differentiate` do this themselves.
   pure subroutine laws_set_time(self, time)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      integer :: i

      if (.not. self%has_turning) return
      do i = 1, size(self%laws)
         associate (law => self%laws(i)%law)
            if (law%n_phases > 0) call law%set_phases(reshape(self%omega*time, [size(self%omega), 1]))
         end associate
      end do
   end subroutine laws_set_time

   !> Stores motion and states as those at the start of a step.
   pure subroutine laws_start_step(self, time, q, v, s)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:), s(:)            !! [m], [m/s], (n_states)

      self%time_start = time
      if (self%n_states == 0) return
      call self%gather(q, v)
      self%z_start = self%z
      self%z_rate_start = self%z_rate
      self%s_start = s
      self%s = s
   end subroutine laws_start_step

   !> Forces at the gathered coordinates; laws with memory follow the path from the start of the step.
   subroutine laws_evaluate(self, elapsed)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in) :: elapsed                                 !! [s] since the start of the step, >= 0
      integer :: i

      call self%set_time(self%time_start + elapsed)
      do i = 1, size(self%spans)
         associate (span => self%spans(i))
            if (span%is_held_back) then
               self%f(span%first:span%last) = 0.0_wp
               cycle
            end if
            span%z(1, :) = self%z(span%first:span%last)
            select type (law => self%laws(i)%law)
            class is (hysteretic_law_t)
               call lay_path(self, span, elapsed)
               call law%advance(span%s_old, span%path, span%s_new)
               call law%force(span%z, span%s_new, span%f)
               self%s(span%first_state:span%last_state) = span%s_new(1, :)
            class default
               if (size(span%v, 2) > 0) span%v(1, :) = self%z_rate(span%first:span%last)
               call law%evaluate(span%z, span%v, span%p, span%f)
            end select
            self%f(span%first:span%last) = span%f(1, :)
         end associate
      end do
   end subroutine laws_evaluate

   !> As `evaluate`, with derivatives of the forces by coordinates and rates.
   subroutine laws_differentiate(self, elapsed, df_dz, df_dv)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in) :: elapsed                                 !! [s]
      real(wp), intent(out) :: df_dz(:, :), df_dv(:, :)               !! (n_coordinates, n_coordinates)
      integer :: c, i, k

      self%n_evaluations = self%n_evaluations + 1_int64
      call self%set_time(self%time_start + elapsed)
      df_dz = 0.0_wp
      df_dv = 0.0_wp
      do i = 1, size(self%spans)
         associate (span => self%spans(i), first => self%spans(i)%first, last => self%spans(i)%last)
            if (span%is_held_back) then
               self%f(first:last) = 0.0_wp
               cycle
            end if
            span%z(1, :) = self%z(first:last)
            select type (law => self%laws(i)%law)
            class is (hysteretic_law_t)
               call lay_path(self, span, elapsed)
               call law%advance(span%s_old, span%path, span%s_new, span%ds_ds_old, span%ds_dpath)
               call law%force(span%z, span%s_new, span%f, span%df_dz, span%df_ds)
               self%s(span%first_state:span%last_state) = span%s_new(1, :)
               df_dz(first:last, first:last) = span%df_dz(1, :, :)
               do c = 1, last - first + 1
                  do k = 1, law%n_states
                     df_dz(first:last, first + c - 1) = df_dz(first:last, first + c - 1) + &
                        span%df_ds(1, :, k)*span%ds_dpath(1, k, c, path_part%at_end)
                     df_dv(first:last, first + c - 1) = df_dv(first:last, first + c - 1) + &
                        elapsed*span%df_ds(1, :, k)*span%ds_dpath(1, k, c, path_part%end_rate)
                  end do
               end do
            class default
               if (size(span%v, 2) > 0) span%v(1, :) = self%z_rate(first:last)
               call law%evaluate(span%z, span%v, span%p, span%f, span%df_dz, span%df_dv, span%df_dp)
               df_dz(first:last, first:last) = span%df_dz(1, :, :)
               if (size(span%v, 2) > 0) df_dv(first:last, first:last) = span%df_dv(1, :, :)
            end select
            self%f(first:last) = span%f(1, :)
         end associate
      end do
   end subroutine laws_differentiate

   pure subroutine lay_path(self, span, elapsed)
      type(integration_laws_t), intent(in) :: self
      type(span_t), intent(inout) :: span
      real(wp), intent(in) :: elapsed

      span%path(1, :, path_part%at_end) = self%z(span%first:span%last)
      span%path(1, :, path_part%at_start) = self%z_start(span%first:span%last)
      span%path(1, :, path_part%end_rate) = elapsed*self%z_rate(span%first:span%last)
      span%path(1, :, path_part%start_rate) = elapsed*self%z_rate_start(span%first:span%last)
      span%s_old(1, :) = self%s_start(span%first_state:span%last_state)
   end subroutine lay_path

   !> Values of all switches for a motion.
   pure subroutine laws_switch_values(self, time, q, v, values)
      class(integration_laws_t), intent(inout) :: self
      real(wp), intent(in) :: time                                    !! [s]
      real(wp), intent(in), contiguous :: q(:), v(:)                  !! [m], [m/s], (n_dofs)
      real(wp), intent(out) :: values(:)                              !! (n_switches)

      if (self%n_switches == 0) return
      call self%set_time(time)
      call self%gather(q, v)
      call self%switches_here(values)
   end subroutine laws_switch_values

   !> Values of all switches at the gathered coordinates and the present time.
   pure subroutine laws_switches_here(self, values)
      class(integration_laws_t), intent(in) :: self
      real(wp), intent(out) :: values(:)                              !! (n_switches)
      integer :: i

      do i = 1, size(self%spans)
         associate (at => self%spans(i))
            if (at%last_switch < at%first_switch) cycle
            call self%laws(i)%law%switches(self%z(at%first:at%last), self%z_rate(at%first:at%last), &
                                           values(at%first_switch:at%last_switch))
         end associate
      end do
   end subroutine laws_switches_here

   !> Whether there are rigid laws.
   pure logical function laws_has_rigid(self)
      class(integration_laws_t), intent(in) :: self

      laws_has_rigid = any(self%spans%is_held_back)
   end function laws_has_rigid

   !> Names of the coordinates: the label of the law, followed by a number if it has several.
   function laws_coordinate_labels(self) result(labels)
      class(integration_laws_t), intent(in) :: self
      character(64) :: labels(self%n_coordinates)
      integer :: c, i

      do i = 1, size(self%spans)
         do c = self%spans(i)%first, self%spans(i)%last
            labels(c) = self%laws(i)%law%label
            if (self%spans(i)%last > self%spans(i)%first) write (labels(c), "(a, a, i0, a)") &
               self%laws(i)%law%label(:min(50, len(self%laws(i)%law%label))), "[", c - self%spans(i)%first + 1, "]"
         end do
      end do
   end function laws_coordinate_labels
end module hb_integration_laws
