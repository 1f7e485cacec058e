!> Impacts on rigid walls, between two steps of the integrator: who is struck, how fast it leaves, and what stays in contact.
submodule (hb_integration_cvode) hb_integration_cvode_impacts
   use hb_lapack, only: dgetrs
   implicit none

   real(wp), parameter :: short_flight = 0.1_wp                       ! relative speed: slower, a step may pass over a flight
   integer, parameter :: no_longer_counted = -1
   integer, parameter :: max_collisions = 1000000                     ! at one time; then the remaining speeds are lost

contains

   module procedure list_impact
      real(wp) :: jump(size(before))

      jump = self%cvode%values(size(before) + 1:) - before
      if (all(abs(jump) <= 0.0_wp)) return
      self%impact_times = [self%impact_times, self%base + t]
      self%impact_jumps = reshape([self%impact_jumps, jump], [size(jump), size(self%impact_times)])
   end procedure list_impact

   module procedure collide
      integer :: i

      if (all(struck == 0)) return
      if (.not. are_coupled(self%equations%yield, self%equations%rigid%is_wall)) then
         do i = 1, size(struck)
            if (struck(i) /= 0) call strike(self, i, struck(i))
         end do
      else
         call collide_in_turn(self, struck)
      end if
   end procedure collide

   !> The same where an impulse at one wall changes the rate at another one.
   subroutine collide_in_turn(self, struck)
      class(integration_cvode_t), intent(inout) :: self
      integer, intent(in) :: struck(:)                                !! as those of `collide`
      real(wp) :: crawling, near, rates(size(struck))
      integer :: i, n, side(size(struck)), touched(size(struck))
      logical :: is_struck(size(struck))

      associate (equations => self%equations, rigid => self%equations%rigid, n_dofs => self%system%n_dofs)
         touched = merge(merge(equations%mode, struck, equations%mode /= 0), 0, rigid%is_wall)
         near = self%tolerance*maxval(equations%scale(:n_dofs))
         crawling = min_bounce_speed*maxval(equations%scale(n_dofs + 1:))
         is_struck = .false.
         do n = 1, max_collisions
            rates = matmul(self%cvode%values(n_dofs + 1:), self%system%laws%shape(:, rigid%coordinate))
            side = merge(touched, near_side(self, near, rates), touched /= 0)
            i = maxloc(side*rates, dim=1, mask=rigid%is_wall)
            if (side(i)*rates(i) <= crawling) exit
            touched(i) = side(i)
            is_struck(i) = .true.
            self%cvode%values(n_dofs + 1:) = self%cvode%values(n_dofs + 1:) - equations%accelerance(:, i)* &
                                             ((1.0_wp + rigid(i)%restitution)*rates(i)/equations%yield(i, i))
            associate (impacts => self%impacts(2*i - merge(1, 0, side(i) == 1)))
               if (impacts >= 0) impacts = impacts + 1
            end associate
         end do
         where (.not. rigid%is_wall) equations%mode = sign(1, equations%mode*2 + 1) ! friction gives no impulse
         equations%leaving = 0
         do i = 1, size(struck)
            if (touched(i) == 0) cycle
            equations%mode(i) = merge(0, touched(i), touched(i)*rates(i) < -crawling)
            if (equations%mode(i) == 0) then
               if (abs(rates(i)) <= short_flight*usual_speed(self)) equations%leaving(i) = touched(i)
            else if (is_struck(i)) then
               self%impacts(2*i - merge(1, 0, touched(i) == 1)) = no_longer_counted
            end if
         end do
         call equations%hold_active()
         if (size(equations%active) > 0) call stop_active(self, 0.0_wp*equations%active)
      end associate
   end subroutine collide_in_turn

   !> Whether an impulse at one wall changes the rate at another one.
   pure logical function are_coupled(yield, is_wall)
      real(wp), intent(in) :: yield(:, :)
      logical, intent(in) :: is_wall(:)
      integer :: i, k

      are_coupled = .false.
      do i = 2, size(is_wall)
         do k = 1, i - 1
            are_coupled = are_coupled .or. (is_wall(i) .and. is_wall(k) .and. abs(yield(i, k)) > 0.0_wp)
         end do
      end do
   end function are_coupled

   !> Side on which each open wall is reached to the accuracy of the integration, and approached; 0: none.
   function near_side(self, near, rates) result(side)
      class(integration_cvode_t), intent(in) :: self
      real(wp), intent(in) :: near                                    !! [m]
      real(wp), intent(in) :: rates(:)                                !! [m/s]
      integer :: side(size(rates))
      integer :: i

      side = 0
      associate (laws => self%system%laws, rigid => self%equations%rigid, q => self%cvode%values(:self%system%n_dofs))
         do i = 1, size(rigid)
            if (.not. rigid(i)%is_wall) cycle
            if (rigid(i)%gap - dot_product(laws%shape(:, rigid(i)%coordinate), q) <= near .and. rates(i) > 0.0_wp) side(i) = 1
            if (.not. rigid(i)%two_sided) cycle
            if (rigid(i)%gap + dot_product(laws%shape(:, rigid(i)%coordinate), q) <= near .and. rates(i) < 0.0_wp) side(i) = -1
         end do
      end associate
   end function near_side

   !> Reflects a coordinate at a wall and counts the impact; bounces that end in contact are not counted, because their number
   !> has no effect.
   subroutine strike(self, i, side)
      class(integration_cvode_t), intent(inout) :: self
      integer, intent(in) :: i, side

      call hit_wall(self, i, side)
      associate (impacts => self%impacts(2*i - merge(1, 0, side == 1)))
         if (impacts >= 0) impacts = merge(impacts + 1, no_longer_counted, self%equations%mode(i) == 0)
      end associate
   end subroutine strike

   module procedure hit_wall
      real(wp) :: back

      associate (equations => self%equations)
         associate (speed => self%system%laws%z_rate(equations%rigid(i)%coordinate))
            back = -equations%rigid(i)%restitution*speed
            if (abs(speed) <= min_bounce_speed*maxval(equations%scale(self%system%n_dofs + 1:))) back = 0.0_wp
         end associate
         where (.not. equations%rigid%is_wall) equations%mode = sign(1, equations%mode*2 + 1)   ! friction gives no impulse
         equations%mode(i) = side
         call equations%hold_active()
         call stop_active(self, merge(back, 0.0_wp, equations%active == i))
         if (abs(back) > 0.0_wp) equations%mode(i) = 0
         equations%leaving = 0                                        ! the impulse may have turned other coordinates
         if (abs(back) > 0.0_wp .and. abs(back) <= short_flight*usual_speed(self)) &
            equations%leaving(i) = side
      end associate
   end procedure hit_wall

   module procedure stop_active
      real(wp) :: accelerance(self%system%n_dofs, size(rates)), jump(size(rates))
      integer :: info, k

      associate (equations => self%equations, v => self%cvode%values(self%system%n_dofs + 1:))
         do k = 1, size(jump)
            jump(k) = dot_product(self%system%laws%shape(:, equations%rigid(equations%active(k))%coordinate), v) - rates(k)
         end do
         call dgetrs("N", size(jump), 1, equations%factor, size(jump), equations%pivots, jump, size(jump), info)
         accelerance = equations%accelerance(:, equations%active)
         v = v - matmul(accelerance, jump)
      end associate
   end procedure stop_active

   !> Largest speed so far or, where bodies have hardly moved, that of their acceleration in the time of the fastest motion [m/s].
   pure real(wp) function usual_speed(self)
      class(integration_cvode_t), intent(in) :: self

      usual_speed = max(maxval(self%equations%scale(self%system%n_dofs + 1:)), &
                        maxval(abs(self%equations%a))*self%time_scale/part_of_fastest)
   end function usual_speed
end submodule hb_integration_cvode_impacts
